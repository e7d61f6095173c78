/* Strings, events and readings, checked against the vocabulary of the world. */

#ifndef MB_SCENE_H
#define MB_SCENE_H

#include "minerva.h"

typedef struct mb_vocabulary {
    mb_document document;
} mb_vocabulary;

/* Replaces the vocabulary by a copy of this map; false, with a problem, if it is none. */
bool mb_load_vocabulary(mb_vocabulary *vocabulary, const mb_value *map);

/* Nodes of a string; their values point into its message. */
typedef struct mb_nodes {
    mb_node *items;
    size_t count;
    size_t room;
} mb_nodes;

/* Adds the nodes of a string of single nodes, as it is in a message. */
bool mb_read_string(const mb_vocabulary *vocabulary, const mb_value *flat, mb_nodes *nodes);
void mb_add_node(mb_nodes *nodes, mb_node node);

bool mb_read_event(const mb_vocabulary *vocabulary, const mb_value *plain, mb_event *event);

/* Writes an event as it is in a message; false, with a problem, if the vocabulary does not allow it. */
bool mb_write_event(const mb_vocabulary *vocabulary, mb_buffer *out, const mb_event *event);

/* Whether a value is a reading. */
bool mb_check_reading(const mb_value *reading);

/* Whether a text can be the name of a world, member or topic. */
bool mb_is_name(const char *text);

#endif
