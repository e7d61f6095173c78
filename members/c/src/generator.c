/* A generator in step: it makes the events of each frame. */

#include <stdlib.h>
#include <string.h>

#include "member.h"
#include "random.h"

enum { MAX_PENDING = 1000 }; /* messages that wait for a tick */

/* Readings on a topic: whole messages, in the order of the topics. */
typedef struct published {
    mb_buffer readings;
    size_t count;
    mb_buffer message;
} published;

typedef struct answer {
    int64_t frame;
    mb_buffer ticked;
    published *topics; /* as many as the generator publishes */
} answer;

typedef struct order {
    int64_t frame;
    mb_document message;
} order;

typedef struct pending {
    int64_t frame;
    char *topic;
    char *publisher;
    mb_document message;
} pending;

typedef struct generator {
    const mb_generator *spec;
    size_t topic_count; /* topics that it publishes */
    bool is_asked;
    int64_t asked, asked_by; /* the frame, and the epoch of the coordinator: its successor asks again */
    bool has_answered;
    answer last;
    order orders[MAX_PENDING];
    size_t order_count;
    pending readings[MAX_PENDING];
    size_t reading_count;
    mb_document sources;
} generator;

struct mb_tick {
    generator *self;
    mb_member *member;
    mb_buffer events;
    size_t event_count;
    published *topics;
    bool has_stream;
    mb_philox stream;
    bool has_failed;
    char problem[256];
};

/* --- what `tick` of a program calls --- */

static void fail_tick(struct mb_tick *tick, const char *problem) {
    if (tick->has_failed) return;
    tick->has_failed = true;
    strncpy(tick->problem, problem, sizeof tick->problem - 1);
}

void mb_emit(mb_moment *moment, mb_event event) {
    struct mb_tick *tick = moment->tick;
    if (mb_write_event(&tick->member->vocabulary, &tick->events, &event)) tick->event_count++;
    else fail_tick(tick, mb_problem());
}

void mb_publish(mb_moment *moment, const char *topic, mb_value reading) {
    struct mb_tick *tick = moment->tick;
    const char *const *topics = tick->self->spec->publishes;
    for (size_t n = 0; n < tick->self->topic_count; n++) {
        if (strcmp(topics[n], topic) != 0) continue;
        if (!mb_check_reading(&reading)) fail_tick(tick, mb_problem());
        mb_write(&tick->topics[n].readings, &reading);
        tick->topics[n].count++;
        return;
    }
    mb_refuse("%s is not among the topics that it publishes", topic);
    fail_tick(tick, mb_problem());
}

double mb_random(mb_moment *moment) {
    struct mb_tick *tick = moment->tick;
    if (!tick->has_stream) tick->stream = mb_philox_of(tick->member->seed, tick->member->name, moment->frame);
    tick->has_stream = true;
    return mb_philox_number(&tick->stream);
}

/* --- answers --- */

static void forget_answer(generator *self) {
    if (!self->has_answered) return;
    self->has_answered = false;
    mb_free(&self->last.ticked);
    for (size_t n = 0; n < self->topic_count; n++) mb_free(&self->last.topics[n].message);
    free(self->last.topics);
}

static bool has_answered(const generator *self, int64_t frame) {
    return self->has_answered && self->last.frame == frame;
}

static void give(const generator *self, mb_member *member) {
    for (size_t n = 0; n < self->topic_count; n++)
        mb_member_publish(member, self->spec->publishes[n], &self->last.topics[n].message);
    mb_member_send(member, &self->last.ticked);
}

/* --- orders and readings that wait for a tick --- */

static void forget_order(generator *self, size_t place) {
    mb_release(&self->orders[place].message);
    self->order_count--;
    memmove(self->orders + place, self->orders + place + 1, (self->order_count - place) * sizeof(order));
}

static void forget_reading(generator *self, size_t place) {
    pending *old = &self->readings[place];
    mb_release(&old->message);
    free(old->topic);
    free(old->publisher);
    self->reading_count--;
    memmove(old, old + 1, (self->reading_count - place) * sizeof(pending));
}

static bool receive_orders(generator *self, const mb_member *member, const mb_value *message) {
    const int64_t frame = message->items[1].integer;
    const mb_value *events = &message->items[2];
    for (size_t n = 0; n < events->size; n++) {
        mb_event event;
        if (!mb_read_event(&member->vocabulary, &events->items[n], &event)) return false;
    }
    size_t place = 0;
    while (place < self->order_count && self->orders[place].frame < frame) place++;
    if (place < self->order_count && self->orders[place].frame == frame) forget_order(self, place);
    if (self->order_count == MAX_PENDING) return mb_refuse("too many orders wait for a tick");
    memmove(self->orders + place + 1, self->orders + place, (self->order_count - place) * sizeof(order));
    self->orders[place] = (order){frame, mb_copy(events)};
    self->order_count++;
    return true;
}

static char *copied(const char *text) { return strcpy(mb_resize(NULL, strlen(text) + 1, 1), text); }

static bool keep_readings(generator *self, const char *topic, const char *publisher, const mb_value *message) {
    const int64_t frame = message->items[1].integer;
    for (size_t n = 0; n < self->reading_count; n++) {
        pending *old = &self->readings[n];
        const bool is_same = old->frame == frame && !strcmp(old->topic, topic) && !strcmp(old->publisher, publisher);
        if (!is_same) continue;
        mb_release(&old->message);
        old->message = mb_copy(&message->items[2]);
        return true;
    }
    if (self->reading_count == MAX_PENDING) return mb_refuse("too many readings wait for a tick");
    self->readings[self->reading_count++] =
        (pending){frame, copied(topic), copied(publisher), mb_copy(&message->items[2])};
    return true;
}

static bool has_readings(const generator *self, const char *topic, const mb_value *publisher) {
    for (size_t n = 0; n < self->reading_count; n++) {
        const pending *at = &self->readings[n];
        if (at->frame == self->asked && !strcmp(at->topic, topic) && mb_is(publisher, at->publisher)) return true;
    }
    return false;
}

/* Whether the readings of all publishers in step are there. */
static bool is_ready(const generator *self) {
    for (const char *const *topic = self->spec->topics; topic != NULL && *topic != NULL; topic++) {
        const mb_value *publishers = mb_find(&self->sources.root, *topic);
        for (size_t n = 0; publishers != NULL && n < publishers->size; n++)
            if (!has_readings(self, *topic, &publishers->items[n])) return false;
    }
    return true;
}

static int by_source(const void *a, const void *b) {
    const pending *left = *(const pending *const *)a, *right = *(const pending *const *)b;
    const int topics = strcmp(left->topic, right->topic), publishers = strcmp(left->publisher, right->publisher);
    if (topics != 0 || publishers != 0) return topics != 0 ? topics : publishers;
    return (left > right) - (left < right); /* in the order of arrival */
}

/* --- ticks --- */

/* The events of orders for this frame or earlier ones; the caller frees them. */
static mb_event *due_orders(const generator *self, const mb_member *member, size_t *count) {
    size_t size = 0;
    for (size_t n = 0; n < self->order_count && self->orders[n].frame <= self->asked; n++)
        size += self->orders[n].message.root.size;
    mb_event *events = mb_resize(NULL, size, sizeof *events);
    *count = 0;
    for (size_t n = 0; n < self->order_count && self->orders[n].frame <= self->asked; n++)
        for (size_t item = 0; item < self->orders[n].message.root.size; item++)
            mb_read_event(&member->vocabulary, &self->orders[n].message.root.items[item], &events[(*count)++]);
    return events;
}

/* The readings of this frame and of free-running publishers, in order; the caller frees them. */
static mb_reading *due_readings(const generator *self, size_t *count) {
    const pending **due = mb_resize(NULL, self->reading_count, sizeof *due);
    size_t due_count = 0, size = 0;
    for (size_t n = 0; n < self->reading_count; n++) {
        const int64_t frame = self->readings[n].frame;
        if (frame != -1 && frame != self->asked) continue;
        due[due_count++] = &self->readings[n];
        size += self->readings[n].message.root.size;
    }
    if (due_count > 0) qsort(due, due_count, sizeof *due, by_source);
    mb_reading *readings = mb_resize(NULL, size, sizeof *readings);
    *count = 0;
    for (size_t n = 0; n < due_count; n++)
        for (size_t item = 0; item < due[n]->message.root.size; item++)
            readings[(*count)++] = (mb_reading){due[n]->topic, due[n]->publisher, due[n]->message.root.items[item]};
    free(due);
    return readings;
}

static void forget_due(generator *self) {
    while (self->order_count > 0 && self->orders[0].frame <= self->asked) forget_order(self, 0);
    for (size_t n = self->reading_count; n > 0; n--)
        if (self->readings[n - 1].frame <= self->asked) forget_reading(self, n - 1);
}

static void call_tick(generator *self, struct mb_tick *tick) {
    mb_moment moment = {.frame = self->asked, .dt = tick->member->dt, .tick = tick};
    mb_event *orders = due_orders(self, tick->member, &moment.order_count);
    mb_reading *readings = due_readings(self, &moment.reading_count);
    moment.orders = orders;
    moment.readings = readings;
    self->spec->tick(&moment, self->spec->state);
    free(orders);
    free(readings);
    forget_due(self);
}

static void write_saved(const generator *self, mb_buffer *out) {
    mb_map saved = {0};
    const mb_value nothing = mb_nil();
    if (self->spec->save == NULL) {
        mb_write(out, &nothing);
        return;
    }
    self->spec->save(self->spec->state, &saved);
    mb_finish_map(out, &saved);
}

static void write_ticked(const generator *self, struct mb_tick *tick, mb_buffer *out) {
    mb_write_list(out, 4);
    mb_write_text(out, "ticked");
    mb_write_int(out, self->asked);
    mb_write_list(out, tick->event_count);
    mb_add(out, tick->events.data, tick->events.size);
    write_saved(self, out);
}

static void write_readings(const generator *self, published *topic) {
    mb_write_list(&topic->message, 3);
    mb_write_text(&topic->message, "readings");
    mb_write_int(&topic->message, self->asked);
    mb_write_list(&topic->message, topic->count);
    mb_add(&topic->message, topic->readings.data, topic->readings.size);
    mb_free(&topic->readings);
}

static void try_to_answer(generator *self, mb_member *member) {
    if (!self->is_asked || self->asked_by != member->epoch || !is_ready(self)) return;
    self->is_asked = false;
    struct mb_tick tick = {.self = self, .member = member};
    tick.topics = mb_resize(NULL, self->topic_count, sizeof *tick.topics);
    for (size_t n = 0; n < self->topic_count; n++) tick.topics[n] = (published){0};
    call_tick(self, &tick);
    answer new = {.frame = self->asked, .topics = tick.topics};
    for (size_t n = 0; n < self->topic_count; n++) write_readings(self, &tick.topics[n]);
    write_ticked(self, &tick, &new.ticked);
    mb_free(&tick.events);
    forget_answer(self);
    self->last = new;
    self->has_answered = true;
    if (tick.has_failed) mb_member_fail(member, tick.problem);
    else give(self, member);
}

static void receive_tick(generator *self, mb_member *member, int64_t frame) {
    if (has_answered(self, frame)) {
        give(self, member);
        return;
    }
    self->is_asked = true;
    self->asked = frame;
    self->asked_by = member->epoch;
    try_to_answer(self, member);
}

static void repeat(const generator *self, mb_member *member, const mb_value *topic) {
    for (size_t n = 0; n < self->topic_count && self->has_answered; n++)
        if (mb_is(topic, self->spec->publishes[n]))
            mb_member_publish(member, self->spec->publishes[n], &self->last.topics[n].message);
}

/* --- the role --- */

static void on_welcome(void *role, mb_member *member, const mb_value *saved, bool is_again) {
    generator *self = role;
    self->is_asked = false;
    while (self->reading_count > 0) forget_reading(self, self->reading_count - 1);
    /* The predecessor's answer to this frame may already count, so it is given again. */
    if (is_again && has_answered(self, member->frame)) return;
    forget_answer(self);
    if (saved->type == MB_MAP && self->spec->restore != NULL) self->spec->restore(self->spec->state, saved);
}

static bool on_message(void *role, mb_member *member, const mb_value *message) {
    generator *self = role;
    const mb_value *name = &message->items[0];
    if (mb_is(name, "tick")) receive_tick(self, member, message->items[1].integer);
    else if (mb_is(name, "orders")) return receive_orders(self, member, message);
    else if (mb_is(name, "repeat")) repeat(self, member, &message->items[1]);
    else if (mb_is(name, "sources")) {
        mb_release(&self->sources);
        self->sources = mb_copy(&message->items[1]);
        try_to_answer(self, member);
    }
    return true;
}

static bool on_readings(void *role, mb_member *member, const char *topic, const char *publisher,
                        const mb_value *message) {
    generator *self = role;
    if (!keep_readings(self, topic, publisher, message)) return false;
    try_to_answer(self, member);
    return true;
}

static void on_report(void *role, mb_map *figures) {
    const mb_generator *spec = ((generator *)role)->spec;
    if (spec->report != NULL) spec->report(spec->state, figures);
}

int mb_run_generator(const mb_generator *spec) {
    generator *self = mb_resize(NULL, 1, sizeof *self);
    *self = (generator){.spec = spec};
    while (spec->publishes != NULL && spec->publishes[self->topic_count] != NULL) self->topic_count++;
    const int code = mb_run((mb_role){
        .hello = {.service = spec->service, .generates = spec->generates, .orders = spec->orders,
                  .topics = spec->topics, .publishes = spec->publishes, .when = "in step", .ticks = true},
        .self = self, .welcome = on_welcome, .receive = on_message, .readings = on_readings, .report = on_report,
    });
    forget_answer(self);
    while (self->order_count > 0) forget_order(self, self->order_count - 1);
    while (self->reading_count > 0) forget_reading(self, self->reading_count - 1);
    mb_release(&self->sources);
    free(self);
    return code;
}
