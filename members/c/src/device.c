/* A device: it draws the views of visual events. */

#include <stdlib.h>
#include <string.h>

#include "member.h"

typedef struct part {
    mb_document id;
    mb_document string;
} part;

/* What is known of the views of one type. */
typedef struct view {
    const char *type;
    int64_t sequence;
    bool has_skeleton;
    mb_document skeleton;
    part *parts; /* sorted by id */
    size_t count;
    size_t room;
} view;

typedef struct device {
    const mb_device *spec;
    view *views;
    size_t count;
} device;

/* --- parts --- */

static int compare(const mb_value *a, const mb_value *b) {
    const size_t size = a->size < b->size ? a->size : b->size;
    const int order = memcmp(a->text, b->text, size);
    return order != 0 ? order : (a->size > b->size) - (a->size < b->size);
}

/* The place of a part, or the one where it would be. */
static size_t place_of(const view *known, const mb_value *id, bool *is_known) {
    size_t low = 0, high = known->count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (compare(&known->parts[middle].id.root, id) < 0) low = middle + 1;
        else high = middle;
    }
    *is_known = low < known->count && compare(&known->parts[low].id.root, id) == 0;
    return low;
}

static void set_part(view *known, const mb_value *id, const mb_value *string) {
    bool is_known;
    const size_t place = place_of(known, id, &is_known);
    if (is_known) {
        mb_release(&known->parts[place].string);
        known->parts[place].string = mb_copy(string);
        return;
    }
    if (known->count == known->room) {
        known->room = known->room == 0 ? 16 : 2 * known->room;
        known->parts = mb_resize(known->parts, known->room, sizeof(part));
    }
    memmove(known->parts + place + 1, known->parts + place, (known->count - place) * sizeof(part));
    known->parts[place] = (part){mb_copy(id), mb_copy(string)};
    known->count++;
}

static void forget_view(view *known) {
    mb_release(&known->skeleton);
    for (size_t n = 0; n < known->count; n++) {
        mb_release(&known->parts[n].id);
        mb_release(&known->parts[n].string);
    }
    known->count = 0;
    known->has_skeleton = false;
}

/* --- views --- */

static bool is_string(const mb_vocabulary *vocabulary, const mb_value *flat) {
    mb_nodes nodes = {0};
    const bool is_read = mb_read_string(vocabulary, flat, &nodes);
    free(nodes.items);
    return is_read;
}

static bool check_view(const mb_vocabulary *vocabulary, const mb_value *parts, const mb_value *skeleton) {
    for (size_t n = 0; n < parts->size; n++)
        if (!is_string(vocabulary, &parts->items[2 * n + 1])) return false;
    return skeleton->type == MB_NIL || is_string(vocabulary, skeleton);
}

/* Takes a view; whether it was not an old one. */
static bool accept(view *known, int64_t sequence, const mb_value *parts, const mb_value *skeleton) {
    const bool is_key = skeleton->type != MB_NIL;
    if (is_key ? sequence < known->sequence : sequence != known->sequence + 1) return false;
    known->sequence = sequence;
    if (is_key) {
        forget_view(known);
        known->skeleton = mb_copy(skeleton);
        known->has_skeleton = true;
    }
    for (size_t n = 0; n < parts->size; n++) set_part(known, &parts->items[2 * n], &parts->items[2 * n + 1]);
    return true;
}

/* The nodes of a view: the skeleton with each slot replaced by the part of its id. */
static mb_nodes filled(const mb_vocabulary *vocabulary, const view *known) {
    mb_nodes skeleton = {0}, nodes = {0};
    mb_read_string(vocabulary, &known->skeleton.root, &skeleton);
    for (size_t n = 0; n < skeleton.count; n++) {
        const mb_node *node = &skeleton.items[n];
        const size_t first = nodes.count;
        bool is_known = false;
        if (node->id.type != MB_TEXT || node->values != NULL) {
            mb_add_node(&nodes, *node);
            continue;
        }
        const size_t place = place_of(known, &node->id, &is_known);
        if (is_known) mb_read_string(vocabulary, &known->parts[place].string.root, &nodes);
        for (size_t inner = first; inner < nodes.count; inner++) nodes.items[inner].depth += node->depth;
    }
    free(skeleton.items);
    return nodes;
}

static void draw(const device *self, const mb_member *member, const view *known, const mb_value *items) {
    mb_nodes nodes = filled(&member->vocabulary, known);
    const mb_view shown = {
        .type = known->type, .frame = items[2].integer, .nodes = nodes.items, .count = nodes.count, .halted = items[6],
    };
    self->spec->draw(&shown, self->spec->state);
    free(nodes.items);
}

static void request_key_view(mb_member *member, const char *type) {
    mb_buffer body = {0};
    mb_write_list(&body, 2);
    mb_write_text(&body, "resync");
    mb_write_text(&body, type);
    mb_member_send(member, &body);
    mb_free(&body);
}

/* `items`: the name, type, frame, sequence, parts, skeleton and halted agents. */
static bool receive_view(device *self, mb_member *member, const mb_value *items) {
    view *known = NULL;
    for (size_t n = 0; n < self->count; n++)
        if (mb_is(&items[1], self->views[n].type)) known = &self->views[n];
    if (known == NULL) return true;
    const int64_t sequence = items[3].integer;
    const mb_value *parts = &items[4], *skeleton = &items[5];
    if (!check_view(&member->vocabulary, parts, skeleton)) return false;
    const bool is_delta = skeleton->type == MB_NIL;
    if (is_delta && (!known->has_skeleton || sequence - 1 > known->sequence)) request_key_view(member, known->type);
    else if (accept(known, sequence, parts, skeleton)) draw(self, member, known, items);
    return true;
}

static void answer_tick(mb_member *member, int64_t frame) {
    const mb_value nothing = mb_nil();
    mb_buffer body = {0};
    mb_write_list(&body, 4);
    mb_write_text(&body, "ticked");
    mb_write_int(&body, frame);
    mb_write_list(&body, 0);
    mb_write(&body, &nothing);
    mb_member_send(member, &body);
    mb_free(&body);
}

/* --- the role --- */

/* Another coordinator may have counted the views, so the next key view is taken whatever its sequence. */
static void on_welcome(void *role, mb_member *member, const mb_value *saved, bool is_again) {
    device *self = role;
    (void)member, (void)saved, (void)is_again;
    for (size_t n = 0; n < self->count; n++) self->views[n].sequence = -1;
}

static bool on_message(void *role, mb_member *member, const mb_value *message) {
    device *self = role;
    if (mb_is(&message->items[0], "view")) return receive_view(self, member, message->items);
    if (mb_is(&message->items[0], "tick") && self->spec->coupled) answer_tick(member, message->items[1].integer);
    return true;
}

static bool on_readings(void *role, mb_member *member, const char *topic, const char *publisher,
                        const mb_value *message) {
    (void)role, (void)member, (void)topic, (void)publisher, (void)message;
    return true;
}

static void on_report(void *role, mb_map *figures) {
    const mb_device *spec = ((device *)role)->spec;
    if (spec->report != NULL) spec->report(spec->state, figures);
}

int mb_run_device(const mb_device *spec) {
    device self = {.spec = spec};
    while (spec->draws != NULL && spec->draws[self.count] != NULL) self.count++;
    self.views = mb_resize(NULL, self.count, sizeof(view));
    for (size_t n = 0; n < self.count; n++) self.views[n] = (view){.type = spec->draws[n], .sequence = -1};
    const int code = mb_run((mb_role){
        .hello = {.service = spec->service, .draws = spec->draws, .when = spec->when, .coupled = spec->coupled,
                  .ticks = spec->coupled},
        .self = &self, .welcome = on_welcome, .receive = on_message, .readings = on_readings, .report = on_report,
    });
    for (size_t n = 0; n < self.count; n++) {
        forget_view(&self.views[n]);
        free(self.views[n].parts);
    }
    free(self.views);
    return code;
}
