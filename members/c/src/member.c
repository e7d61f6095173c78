#include "member.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum { VERSION = 7, GREETING = 10, SUCCESSOR = 5, FLUSHING = 1, LONGEST_KEY = 256 };
enum { RAISED = 70 }; /* exit code after an error that the same input would cause again */

mb_member mb_member_of(const char *name, mb_role role, mb_outside outside) {
    return (mb_member){.name = name, .role = role, .outside = outside, .epoch = -1, .asked_for = -1};
}

void mb_member_subscribe(const mb_member *member, void (*subscribe)(void *self, const char *key)) {
    const mb_hello *hello = &member->role.hello;
    char key[LONGEST_KEY];
    subscribe(member->outside.self, "all");
    snprintf(key, sizeof key, "to/%s", member->name);
    subscribe(member->outside.self, key);
    if (hello->ticks) subscribe(member->outside.self, "tick");
    for (const char *const *type = hello->draws; !hello->coupled && type != NULL && *type != NULL; type++) {
        snprintf(key, sizeof key, "view/%s", *type);
        subscribe(member->outside.self, key);
    }
    for (const char *const *topic = hello->topics; topic != NULL && *topic != NULL; topic++) {
        snprintf(key, sizeof key, "topic/%s/*", *topic);
        subscribe(member->outside.self, key);
    }
}

void mb_member_begin(mb_member *member) { member->outside.wait(member->outside.self, GREETING, 1); }

/* --- sending --- */

void mb_member_send(mb_member *member, const mb_buffer *body) {
    char key[LONGEST_KEY];
    mb_buffer message = {0};
    snprintf(key, sizeof key, "from/%s", member->name);
    mb_write_int(&message, member->epoch);
    mb_add(&message, body->data, body->size);
    member->outside.put(member->outside.self, key, message.data, message.size);
    mb_free(&message);
}

void mb_member_publish(mb_member *member, const char *topic, const mb_buffer *body) {
    char key[LONGEST_KEY];
    snprintf(key, sizeof key, "topic/%s/%s", topic, member->name);
    member->outside.put(member->outside.self, key, body->data, body->size);
}

static void write_texts(mb_buffer *out, const char *key, const char *const *texts) {
    size_t count = 0;
    while (texts != NULL && texts[count] != NULL) count++;
    mb_write_text(out, key);
    mb_write_list(out, count);
    for (size_t n = 0; n < count; n++) mb_write_text(out, texts[n]);
}

static void send_hello(mb_member *member) {
    const mb_hello *hello = &member->role.hello;
    const struct { const char *key; const char *const *texts; } lists[] = {
        {"kinds", NULL},          {"generates", hello->generates}, {"orders", hello->orders},
        {"draws", hello->draws},  {"topics", hello->topics},       {"publishes", hello->publishes},
    };
    const size_t count = sizeof lists / sizeof *lists;
    mb_map map = {0}, about = {0};
    mb_set(&map, "version", mb_int(VERSION));
    mb_set(&map, "when", mb_text(hello->when == NULL ? "" : hello->when));
    mb_set(&map, "coupled", mb_bool(hello->coupled));
    mb_set(&map, "plain", mb_bool(true));
    mb_set(&about, "service", mb_text(hello->service == NULL ? "" : hello->service));
    mb_set(&about, "pid", mb_int(getpid()));
    mb_write_text(&map.entries, "about");
    mb_finish_map(&map.entries, &about);
    map.count++;
    for (size_t n = 0; n < count; n++) write_texts(&map.entries, lists[n].key, lists[n].texts);
    map.count += count;
    mb_buffer body = {0};
    mb_write_list(&body, 2);
    mb_write_text(&body, "hello");
    mb_finish_map(&body, &map);
    mb_member_send(member, &body);
    mb_free(&body);
}

static void send_report(mb_member *member) {
    mb_buffer body = {0};
    mb_map figures = {0};
    member->role.report(member->role.self, &figures);
    mb_write_list(&body, 2);
    mb_write_text(&body, "report");
    mb_finish_map(&body, &figures);
    mb_member_send(member, &body);
    mb_free(&body);
}

void mb_member_leave(mb_member *member) {
    mb_buffer body = {0};
    mb_write_list(&body, 1);
    mb_write_text(&body, "leaving");
    if (member->has_joined) mb_member_send(member, &body);
    mb_free(&body);
    member->outside.end(member->outside.self, 0);
}

void mb_member_fail(mb_member *member, const char *problem) {
    mb_buffer body = {0};
    mb_write_list(&body, 4);
    mb_write_text(&body, "failed");
    mb_write_int(&body, member->asked_for);
    mb_write_text(&body, problem);
    mb_write_text(&body, "");
    mb_member_send(member, &body);
    mb_free(&body);
    member->outside.log(member->outside.self, problem);
    member->outside.end(member->outside.self, RAISED);
}

/* --- receiving --- */

/* Items of the coordinator's messages: t text, f frame, i int, n number, m map, l list, x list of texts,
 * M map or nil, L list or nil, s map of lists of texts. */
static const char *const ITEMS[][2] = {
    {"greet", ""},      {"welcome", "tminftM"}, {"refused", "t"},    {"sources", "s"},
    {"tick", "f"},      {"fragments", "mx"},    {"evolve", "fxllfx"}, {"view", "tffmLx"},
    {"orders", "fl"},   {"repeat", "t"},        {"stop", "t"},
};

static bool are_texts(const mb_value *value) {
    for (size_t n = 0; value->type == MB_LIST && n < value->size; n++)
        if (value->items[n].type != MB_TEXT) return false;
    return value->type == MB_LIST;
}

static bool are_sources(const mb_value *value) {
    for (size_t n = 0; value->type == MB_MAP && n < value->size; n++)
        if (!are_texts(&value->items[2 * n + 1])) return false;
    return value->type == MB_MAP;
}

static bool is_item(char kind, const mb_value *value) {
    switch (kind) {
        case 't': return value->type == MB_TEXT;
        case 'f': return value->type == MB_INT && value->integer >= 0;
        case 'i': return value->type == MB_INT;
        case 'n': return value->type == MB_INT || (value->type == MB_REAL && isfinite(value->real));
        case 'm': return value->type == MB_MAP;
        case 'l': return value->type == MB_LIST;
        case 'x': return are_texts(value);
        case 'M': return value->type == MB_MAP || value->type == MB_NIL;
        case 'L': return value->type == MB_LIST || value->type == MB_NIL;
        default: return are_sources(value);
    }
}

static bool check_message(const mb_value *message) {
    if (message->type != MB_LIST || message->size == 0) return mb_refuse("not a message");
    for (size_t n = 0; n < sizeof ITEMS / sizeof *ITEMS; n++) {
        const char *name = ITEMS[n][0], *kinds = ITEMS[n][1];
        if (!mb_is(&message->items[0], name)) continue;
        bool is_right = message->size == strlen(kinds) + 1;
        for (size_t item = 0; is_right && kinds[item] != 0; item++)
            is_right = is_item(kinds[item], &message->items[item + 1]);
        return is_right || mb_refuse("the items of %s", name);
    }
    return mb_refuse("an unknown message");
}

/* Whether a message is of the coordinator that the member obeys. */
static bool follows(mb_member *member, int64_t epoch, const mb_value *name) {
    const bool is_leading = mb_is(name, "greet") || mb_is(name, "refused") || mb_is(name, "stop");
    if (epoch > member->epoch && is_leading) {
        member->epoch = epoch;
        member->obeys = true;
    }
    return member->obeys && epoch == member->epoch;
}

static bool receive_welcome(mb_member *member, const mb_value *items) {
    const bool is_again = member->has_joined;
    const double dt = mb_number(&items[4]);
    if (is_again && (items[3].integer != member->seed || dt != member->dt)) {
        member->outside.log(member->outside.self, "the world has another seed or step than before");
        member->outside.end(member->outside.self, 1);
        return true;
    }
    if (!mb_load_vocabulary(&member->vocabulary, &items[2])) return false;
    member->seed = items[3].integer;
    member->dt = dt;
    member->frame = items[5].integer;
    member->has_joined = true;
    member->outside.wait(member->outside.self, 0, 0);
    member->role.welcome(member->role.self, member, &items[7], is_again);
    return true;
}

static void receive_refusal(mb_member *member, const mb_value *reason) {
    char text[300];
    snprintf(text, sizeof text, "refused: %.*s", (int)(reason->size < 250 ? reason->size : 250), reason->text);
    member->outside.log(member->outside.self, text);
    member->outside.end(member->outside.self, 2);
}

static bool act(mb_member *member, const mb_value *message) {
    const mb_value *name = &message->items[0];
    if (mb_is(name, "greet")) send_hello(member);
    else if (mb_is(name, "welcome")) return receive_welcome(member, message->items);
    else if (mb_is(name, "refused")) receive_refusal(member, &message->items[1]);
    else if (mb_is(name, "stop")) {
        /* The report must arrive before the session ends, so it stays for a moment. */
        send_report(member);
        member->is_stopping = true;
        member->outside.wait(member->outside.self, FLUSHING, 0);
    } else if (member->has_joined || mb_is(name, "sources")) {
        if (mb_is(name, "tick") || mb_is(name, "evolve")) member->asked_for = message->items[1].integer;
        if (mb_is(name, "view")) member->asked_for = message->items[2].integer;
        return member->role.receive(member->role.self, member, message);
    }
    return true;
}

static bool receive_from_coordinator(mb_member *member, const uint8_t *data, size_t size) {
    mb_document epoch = {0}, message = {0};
    size_t used;
    bool is_read = mb_read(&epoch, data, size, &used);
    if (is_read && epoch.root.type != MB_INT) is_read = mb_refuse("a message without an epoch");
    is_read = is_read && mb_read(&message, data + used, size - used, NULL) && check_message(&message.root);
    if (is_read && follows(member, epoch.root.integer, &message.root.items[0])) is_read = act(member, &message.root);
    mb_release(&message);
    mb_release(&epoch);
    return is_read;
}

static bool check_readings(const mb_value *message) {
    const bool is_message = message->type == MB_LIST && message->size == 3 && mb_is(&message->items[0], "readings") &&
                            message->items[1].type == MB_INT && message->items[1].integer >= -1 &&
                            message->items[2].type == MB_LIST;
    if (!is_message) return mb_refuse("not readings");
    for (size_t n = 0; n < message->items[2].size; n++)
        if (!mb_check_reading(&message->items[2].items[n])) return false;
    return true;
}

/* `key` is topic/<topic>/<publisher>. */
static bool receive_readings(mb_member *member, const char *key, const uint8_t *data, size_t size) {
    char topic[LONGEST_KEY];
    const char *first = strchr(key, '/') + 1, *publisher = strchr(first, '/');
    if (!member->has_joined) return true;
    if (publisher == NULL || (size_t)(publisher - first) >= sizeof topic) return mb_refuse("not readings");
    memcpy(topic, first, (size_t)(publisher - first));
    topic[publisher - first] = 0;
    mb_document message;
    if (!mb_read(&message, data, size, NULL)) return false;
    const bool is_read = check_readings(&message.root) &&
                         member->role.readings(member->role.self, member, topic, publisher + 1, &message.root);
    mb_release(&message);
    return is_read;
}

void mb_member_receive(mb_member *member, const char *key, const uint8_t *data, size_t size) {
    const bool is_topic = strncmp(key, "topic/", 6) == 0;
    const bool is_read =
        size > MB_MESSAGE_BYTES ? mb_refuse("it is too large")
        : is_topic              ? receive_readings(member, key, data, size)
                                : receive_from_coordinator(member, data, size);
    if (is_read) return;
    char text[400];
    snprintf(text, sizeof text, "dropped a message on %.64s: %s", key, mb_problem());
    member->outside.log(member->outside.self, text);
}

/* --- the coordinator --- */

void mb_member_coordinator(mb_member *member, bool is_there) {
    const mb_outside *outside = &member->outside;
    if (member->is_stopping) {
        if (!is_there) outside->end(outside->self, 0);
        return;
    }
    if (!is_there && member->has_coordinator) {
        outside->release(outside->self);
        /* The same coordinator may come back with the same epoch, but must greet first. */
        member->epoch--;
        member->obeys = false;
        outside->wait(outside->self, SUCCESSOR, 1);
    } else if (is_there && !member->has_coordinator && outside->is_released(outside->self)) {
        outside->rejoin(outside->self);
    }
    member->has_coordinator = is_there;
}
