#include "scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LONGEST_NAME = 64, DEEPEST_STRING = 100000 };

static const char LETTERS_AND_DIGITS[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_";

static bool consists_of(const char *text, size_t size, const char *more) {
    for (size_t n = 0; n < size; n++) {
        const bool is_allowed = text[n] != 0 && (strchr(LETTERS_AND_DIGITS, text[n]) || (n > 0 && strchr(more, text[n])));
        if (!is_allowed) return false;
    }
    return size > 0;
}

bool mb_is_name(const char *text) {
    const size_t size = strlen(text);
    return size <= LONGEST_NAME && consists_of(text, size, ".~-");
}

/* --- vocabularies --- */

static bool is_field(const mb_value *field) {
    return field->type == MB_LIST && field->size >= 2 && field->items[0].type == MB_TEXT &&
           field->items[1].type == MB_TEXT;
}

static bool is_symbol(const mb_value *symbol) {
    if (symbol->type != MB_LIST || symbol->size < 2 || symbol->items[0].type != MB_TEXT) return false;
    const mb_value *fields = &symbol->items[1];
    if (fields->type != MB_LIST) return false;
    for (size_t n = 0; n < fields->size; n++)
        if (!is_field(&fields->items[n])) return false;
    return true;
}

static const char *const PARTS[] = {"primitives", "transformations", "kinds", "events"};

bool mb_load_vocabulary(mb_vocabulary *vocabulary, const mb_value *map) {
    for (size_t part = 0; part < 4; part++) {
        const mb_value *symbols = mb_find(map, PARTS[part]);
        if (symbols == NULL || symbols->type != MB_LIST) return mb_refuse("a vocabulary without %s", PARTS[part]);
        for (size_t n = 0; n < symbols->size; n++)
            if (!is_symbol(&symbols->items[n])) return mb_refuse("an invalid vocabulary: %s", PARTS[part]);
    }
    mb_release(&vocabulary->document);
    vocabulary->document = mb_copy(map);
    return true;
}

/* The fields of a symbol or event type; NULL, with a problem, if there is no such one. */
static const mb_value *fields_of(const mb_vocabulary *vocabulary, const char *part, const mb_value *name) {
    const mb_value *symbols = mb_find(&vocabulary->document.root, part);
    for (size_t n = 0; symbols != NULL && n < symbols->size; n++)
        if (mb_same_text(&symbols->items[n].items[0], name)) return &symbols->items[n].items[1];
    const bool is_text = name->type == MB_TEXT;
    mb_refuse("the world's vocabulary has no %.*s", is_text ? (int)name->size : 9, is_text ? name->text : "such name");
    return NULL;
}

/* --- values --- */

static bool begins_with(const mb_value *type, const char *word) {
    const size_t size = strlen(word);
    const bool begins = type->size >= size && memcmp(type->text, word, size) == 0;
    return begins && (type->size == size || type->text[size] == ' ');
}

static bool is_real(const mb_value *value) {
    return value->type == MB_INT || value->type == MB_UINT || (value->type == MB_REAL && isfinite(value->real));
}

static const char LIST_OF[] = "list of ";

static bool is_list_type(const mb_value *type) {
    return type->size > strlen(LIST_OF) && memcmp(type->text, LIST_OF, strlen(LIST_OF)) == 0;
}

static mb_value item_type(const mb_value *type) {
    mb_value item = *type;
    item.text += strlen(LIST_OF);
    item.size -= strlen(LIST_OF);
    return item;
}

static bool is_extension(const mb_value *value, int8_t type) {
    return value->type == MB_EXTENSION && value->extension == type;
}

static bool has_type(const mb_value *value, const mb_value *type) {
    if (is_list_type(type)) {
        const mb_value item = item_type(type);
        for (size_t n = 0; value->type == MB_LIST && n < value->size; n++)
            if (!has_type(&value->items[n], &item)) return false;
        return value->type == MB_LIST;
    }
    if (begins_with(type, "real")) return is_real(value);
    if (begins_with(type, "int")) return value->type == MB_INT;
    if (begins_with(type, "bool")) return value->type == MB_BOOL;
    if (begins_with(type, "text")) return value->type == MB_TEXT;
    if (begins_with(type, "cells") || begins_with(type, "matrix")) return is_extension(value, 1);
    return begins_with(type, "string") && is_extension(value, 2);
}

static bool check_values(const mb_value *values, const mb_value *fields, const mb_value *name) {
    const bool is_list = values->type == MB_LIST;
    if (!is_list || values->size != fields->size)
        return mb_refuse("%.*s needs %zu values; got %zu", (int)name->size, name->text, fields->size,
                         is_list ? values->size : 0);
    for (size_t n = 0; n < fields->size; n++) {
        const mb_value *field = &fields->items[n].items[0], *type = &fields->items[n].items[1];
        if (!has_type(&values->items[n], type))
            return mb_refuse("%.*s of %.*s is not of type %.*s", (int)field->size, field->text, (int)name->size,
                             name->text, (int)type->size, type->text);
    }
    return true;
}

/* Writes a value of a type: an integer is accepted as a real. */
static void write_value(mb_buffer *out, const mb_value *value, const mb_value *type) {
    if (is_list_type(type)) {
        const mb_value item = item_type(type);
        mb_write_list(out, value->size);
        for (size_t n = 0; n < value->size; n++) write_value(out, &value->items[n], &item);
    } else if (begins_with(type, "real")) {
        const mb_value real = mb_real(mb_number(value));
        mb_write(out, &real);
    } else {
        mb_write(out, value);
    }
}

/* --- strings --- */

void mb_add_node(mb_nodes *nodes, mb_node node) {
    if (nodes->count == nodes->room) {
        nodes->room = nodes->room == 0 ? 16 : 2 * nodes->room;
        nodes->items = mb_resize(nodes->items, nodes->room, sizeof node);
    }
    nodes->items[nodes->count++] = node;
}

static bool is_id(const mb_value *value) {
    return value->type == MB_TEXT && consists_of(value->text, value->size, ":-");
}

/* The form of a node: number of its items, and the part of the vocabulary with its symbol. */
static bool node_form(const mb_value *symbol, size_t *size, const char **part) {
    static const char letters[] = "PTA";
    const char *letter = symbol->size > 0 ? strchr(letters, symbol->text[0]) : NULL;
    if (letter == NULL || *letter == 0) return false;
    *size = (size_t)(letter - letters) + 2;
    *part = PARTS[letter - letters];
    return true;
}

static bool read_node(const mb_vocabulary *vocabulary, const mb_value *piece, mb_node *node, size_t *count) {
    size_t size;
    const char *part;
    const bool is_node = piece->type == MB_LIST && piece->size > 0 && piece->items[0].type == MB_TEXT;
    if (!is_node || !node_form(&piece->items[0], &size, &part) || piece->size != size) return mb_refuse("not a node");
    *node = (mb_node){.symbol = piece->items[0]};
    *count = 0;
    const mb_value *fields = fields_of(vocabulary, part, &node->symbol);
    if (fields == NULL) return false;
    const mb_value *values = &piece->items[size == 4 ? 2 : 1];
    const bool is_slot = size == 4 && values->type == MB_NIL;
    if (size == 4) {
        node->id = piece->items[1];
        /* The slot of a part of a population has the name of the part, which is no id. */
        if (is_slot ? node->id.type != MB_TEXT : !is_id(&node->id)) return mb_refuse("an invalid id");
    }
    if (size > 2) {
        const mb_value *scope = &piece->items[size - 1];
        if (scope->type != MB_INT || scope->integer < 0) return mb_refuse("a scope without a count");
        *count = (size_t)scope->integer;
    }
    if (is_slot) return true;
    if (!check_values(values, fields, &node->symbol)) return false;
    node->values = values->items;
    node->value_count = values->size;
    return true;
}

/* Numbers of nodes that scopes still lack, from outside to inside: a stack, because strings may be deep. */
typedef struct scopes {
    size_t *missing;
    size_t depth;
    size_t room;
} scopes;

static bool open_scope(scopes *open, size_t count) {
    if (open->depth == DEEPEST_STRING) return mb_refuse("a string is nested too deeply");
    if (open->depth == open->room) {
        open->room = open->room == 0 ? 16 : 2 * open->room;
        open->missing = mb_resize(open->missing, open->room, sizeof *open->missing);
    }
    open->missing[open->depth++] = count;
    return true;
}

static void close_scopes(scopes *open) {
    while (open->depth > 0 && open->missing[open->depth - 1] == 0) open->depth--;
}

static bool read_pieces(const mb_vocabulary *vocabulary, const mb_value *flat, mb_nodes *nodes, scopes *open) {
    for (size_t n = 1; n < flat->size; n++) {
        mb_node node;
        size_t count;
        if (open->depth == 0) return mb_refuse("a string has data after its end");
        if (!read_node(vocabulary, &flat->items[n], &node, &count)) return false;
        open->missing[open->depth - 1]--;
        node.depth = open->depth - 1;
        mb_add_node(nodes, node);
        if (count > 0 && !open_scope(open, count)) return false;
        close_scopes(open);
    }
    return open->depth == 0 || mb_refuse("a string is cut off");
}

bool mb_read_string(const mb_vocabulary *vocabulary, const mb_value *flat, mb_nodes *nodes) {
    const bool is_string = flat->type == MB_LIST && flat->size > 0 && flat->items[0].type == MB_INT;
    if (!is_string || flat->items[0].integer < 0) return mb_refuse("not a string");
    scopes open = {0};
    open_scope(&open, (size_t)flat->items[0].integer);
    close_scopes(&open);
    const bool is_read = read_pieces(vocabulary, flat, nodes, &open);
    free(open.missing);
    return is_read;
}

/* --- events --- */

static bool is_text_or_nil(const mb_value *value) { return value->type == MB_TEXT || value->type == MB_NIL; }

static bool are_texts(const mb_value *value) {
    for (size_t n = 0; value->type == MB_LIST && n < value->size; n++)
        if (value->items[n].type != MB_TEXT) return false;
    return value->type == MB_LIST;
}

static bool check_event(const mb_vocabulary *vocabulary, const mb_event *event, const mb_value **fields) {
    *fields = fields_of(vocabulary, "events", &event->type);
    if (*fields == NULL) return false;
    const bool is_bare = event->values.type == MB_NIL && (*fields)->size == 0;
    if (!is_bare && !check_values(&event->values, *fields, &event->type)) return false;
    if (!is_text_or_nil(&event->condition)) return mb_refuse("a condition that is not text");
    if (!is_text_or_nil(&event->sender)) return mb_refuse("a sender that is not text");
    const bool has_receivers = event->receivers.type == MB_NIL || are_texts(&event->receivers);
    return has_receivers || mb_refuse("receivers that are not ids");
}

bool mb_read_event(const mb_vocabulary *vocabulary, const mb_value *plain, mb_event *event) {
    const bool is_event = plain->type == MB_LIST && (plain->size == 2 || plain->size == 5);
    if (!is_event) return mb_refuse("not an event");
    *event = (mb_event){.type = plain->items[0], .values = plain->items[1]};
    if (plain->size == 5) {
        event->condition = plain->items[2];
        event->sender = plain->items[3];
        event->receivers = plain->items[4];
        if (event->condition.type == MB_NIL || event->sender.type == MB_NIL || event->receivers.type == MB_NIL)
            return mb_refuse("not an event");
    }
    const mb_value *fields;
    return event->values.type == MB_LIST ? check_event(vocabulary, event, &fields) : mb_refuse("not an event");
}

static int compare_texts(const void *a, const void *b) {
    const mb_value *left = a, *right = b;
    const size_t size = left->size < right->size ? left->size : right->size;
    const int order = memcmp(left->text, right->text, size);
    return order != 0 ? order : (left->size > right->size) - (left->size < right->size);
}

/* Sorted, each once. */
static void write_receivers(mb_buffer *out, const mb_value *receivers) {
    const size_t size = receivers->type == MB_LIST ? receivers->size : 0;
    mb_value *sorted = mb_resize(NULL, size, sizeof *sorted);
    size_t count = 0;
    if (size > 0) memcpy(sorted, receivers->items, size * sizeof *sorted);
    qsort(sorted, size, sizeof *sorted, compare_texts);
    for (size_t n = 0; n < size; n++)
        if (count == 0 || !mb_same_text(&sorted[count - 1], &sorted[n])) sorted[count++] = sorted[n];
    const mb_value unique = mb_list(sorted, count);
    mb_write(out, &unique);
    free(sorted);
}

static void write_text_or_empty(mb_buffer *out, const mb_value *text) {
    const mb_value empty = mb_text("");
    mb_write(out, text->type == MB_TEXT ? text : &empty);
}

bool mb_write_event(const mb_vocabulary *vocabulary, mb_buffer *out, const mb_event *event) {
    const mb_value *fields;
    if (!check_event(vocabulary, event, &fields)) return false;
    const bool is_long = event->condition.size > 0 || event->sender.size > 0 || event->receivers.size > 0;
    mb_write_list(out, is_long ? 5 : 2);
    mb_write(out, &event->type);
    mb_write_list(out, fields->size);
    for (size_t n = 0; n < fields->size; n++) write_value(out, &event->values.items[n], &fields->items[n].items[1]);
    if (!is_long) return true;
    write_text_or_empty(out, &event->condition);
    write_text_or_empty(out, &event->sender);
    write_receivers(out, &event->receivers);
    return true;
}

/* --- readings --- */

/* Items after the type: t text, r real (also infinite), n real or nil, i int, b bytes,
 * p place, s sightings, m motion. */
static const char *const READINGS[][2] = {
    {"scan", "trbrrrp"},    {"sweep", "trbrrrprm"}, {"sightings", "trs"},  {"image", "trtiibp"},
    {"odometry", "trrrrrr"}, {"battery", "trrr"},    {"position", "trrrnn"},
};

static bool is_measure(const mb_value *value) {
    return value->type == MB_INT || value->type == MB_UINT || (value->type == MB_REAL && !isnan(value->real));
}

static bool are_measures(const mb_value *value, size_t first, size_t size) {
    if (value->type != MB_LIST || value->size != size) return false;
    for (size_t n = first; n < size; n++)
        if (!is_measure(&value->items[n])) return false;
    return true;
}

static bool is_each(const mb_value *list, bool (*check)(const mb_value *)) {
    for (size_t n = 0; list->type == MB_LIST && n < list->size; n++)
        if (!check(&list->items[n])) return false;
    return list->type == MB_LIST;
}

static bool is_sighting(const mb_value *value) {
    return are_measures(value, 1, 3) && value->items[0].type == MB_TEXT;
}

static bool is_motion(const mb_value *value) { return are_measures(value, 0, 4); }

static bool is_item(char kind, const mb_value *value) {
    switch (kind) {
        case 't': return value->type == MB_TEXT;
        case 'r': return is_measure(value);
        case 'n': return value->type == MB_NIL || is_measure(value);
        case 'i': return value->type == MB_INT;
        case 'b': return value->type == MB_BYTES;
        case 'p': return are_measures(value, 0, 3);
        case 's': return is_each(value, is_sighting);
        default: return is_each(value, is_motion);
    }
}

bool mb_check_reading(const mb_value *reading) {
    if (reading->type != MB_LIST || reading->size == 0) return mb_refuse("not a reading");
    for (size_t n = 0; n < sizeof READINGS / sizeof *READINGS; n++) {
        const char *name = READINGS[n][0], *kinds = READINGS[n][1];
        if (!mb_is(&reading->items[0], name)) continue;
        if (reading->size != strlen(kinds) + 1) return mb_refuse("%s has %zu items", name, strlen(kinds) + 1);
        for (size_t item = 0; kinds[item] != 0; item++)
            if (!is_item(kinds[item], &reading->items[item + 1])) return mb_refuse("item %zu of %s", item + 1, name);
        return true;
    }
    return mb_refuse("an unknown reading");
}
