/* The member of the conformance suite, in the role of MINERVA_ROLE (docs/howto/other-languages.md). */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../src/minerva.h"

static mb_event add(mb_value *amount) {
    return (mb_event){.type = mb_text("eAdd"), .values = mb_list(amount, 1)};
}

static void emit_sightings(mb_moment *moment, const mb_reading *reading) {
    if (!mb_is(&reading->items.items[0], "sightings")) return;
    const mb_value *seen = &reading->items.items[3];
    for (size_t n = 0; n < seen->size; n++) {
        mb_value distance = seen->items[n].items[1];
        mb_emit(moment, add(&distance));
    }
}

static void count_tick(mb_moment *moment, void *state) {
    int64_t *count = state;
    mb_value amount = mb_real((double)*count + 0.5);
    mb_publish(moment, "echo",
               MB_LIST(mb_text("battery"), mb_text("r1"), mb_real((double)moment->frame), mb_real(1.0),
                       mb_real((double)*count)));
    *count += 1;
    mb_emit(moment, add(&amount));
    for (size_t n = 0; n < moment->order_count; n++) mb_emit(moment, moment->orders[n]);
    for (size_t n = 0; n < moment->reading_count; n++) emit_sightings(moment, &moment->readings[n]);
}

static void save_count(const void *state, mb_map *saved) { mb_set(saved, "count", mb_int(*(const int64_t *)state)); }

static void restore_count(void *state, const mb_value *saved) {
    const mb_value *count = mb_find(saved, "count");
    if (count != NULL && count->type == MB_INT) *(int64_t *)state = count->integer;
}

static void report_ticks(const void *state, mb_map *figures) {
    mb_set(figures, "ticks", mb_int(*(const int64_t *)state));
}

static int run_generator(void) {
    int64_t count = 0;
    return mb_run_generator(&(mb_generator){
        .generates = MB_TEXTS("eAdd"),
        .orders = MB_TEXTS("eAdd"),
        .topics = MB_TEXTS("sight"),
        .publishes = MB_TEXTS("echo"),
        .state = &count,
        .tick = count_tick,
        .save = save_count,
        .restore = restore_count,
        .report = report_ticks,
    });
}

typedef struct bars {
    bool is_coupled;
    int64_t count, frame, views; /* no views: nothing was drawn */
    double length;
} bars;

static void draw(const mb_view *view, void *state) {
    bars *self = state;
    self->views++;
    self->frame = view->frame;
    self->count = (int64_t)view->count;
    self->length = 0.0;
    for (size_t n = 0; n < view->count; n++) self->length += mb_number(&view->nodes[n].values[0]);
}

static void report_bars(const void *state, mb_map *figures) {
    const bars *self = state;
    if (self->views > 0) {
        mb_set(figures, "bars", mb_int(self->count));
        mb_set(figures, "length", mb_real(self->length));
        mb_set(figures, "frame", mb_int(self->frame));
    }
    if (self->is_coupled) mb_set(figures, "views", mb_int(self->views));
}

static int run_device(bool is_coupled) {
    bars self = {.is_coupled = is_coupled};
    return mb_run_device(&(mb_device){
        .draws = MB_TEXTS("eShow"),
        .when = "each frame",
        .coupled = is_coupled,
        .state = &self,
        .draw = draw,
        .report = report_bars,
    });
}

int main(void) {
    const char *role = getenv("MINERVA_ROLE");
    if (role == NULL || strcmp(role, "generator") == 0) return run_generator();
    if (strcmp(role, "observer") == 0) return run_device(false);
    if (strcmp(role, "coupled") == 0) return run_device(true);
    fprintf(stderr, "MINERVA_ROLE must be generator, observer or coupled\n");
    return 1;
}
