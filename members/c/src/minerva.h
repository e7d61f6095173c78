/* Members of Minerva Bus in C: generators in step and devices. */

#ifndef MB_MINERVA_H
#define MB_MINERVA_H

#include "msgpack.h"

/* A list of values, such as MB_LIST(mb_real(0.2)); it lives as long as the block around it. */
#define MB_LIST(...) \
    mb_list((mb_value[]){__VA_ARGS__}, sizeof((mb_value[]){__VA_ARGS__}) / sizeof(mb_value))

/* A list of texts that ends with NULL. */
#define MB_TEXTS(...) ((const char *const[]){__VA_ARGS__, NULL})

/* An event. What is not set is nil: no values, no condition, no sender, for everyone who subscribes. */
typedef struct mb_event {
    mb_value type;
    mb_value values;    /* a list, in the order of the vocabulary */
    mb_value condition; /* text */
    mb_value sender;    /* text: an agent for which the member may speak */
    mb_value receivers; /* a list of ids */
} mb_event;

/* A reading of another member, as it is in the message (PROTOCOL.md, section 11). */
typedef struct mb_reading {
    const char *topic;
    const char *publisher;
    mb_value items; /* a list: type, robot, time, ... */
} mb_reading;

/* A frame that asks a generator for its events. */
typedef struct mb_moment {
    int64_t frame;
    double dt; /* seconds */
    const mb_event *orders; /* events of people */
    size_t order_count;
    const mb_reading *readings;
    size_t reading_count;
    struct mb_tick *tick; /* of the library */
} mb_moment;

/* Adds an event to those of the frame. One that the vocabulary does not allow ends the member. */
void mb_emit(mb_moment *moment, mb_event event);

/* Publishes a reading, a list, on one of the generator's topics. */
void mb_publish(mb_moment *moment, const char *topic, mb_value reading);

/* The next number, from 0 to less than 1, of the stream of (seed, name, frame). */
double mb_random(mb_moment *moment);

/* A generator. Lists of texts end with NULL; NULL stands for an empty one. */
typedef struct mb_generator {
    const char *service; /* what it is, for people */
    const char *const *generates;
    const char *const *orders;
    const char *const *topics;
    const char *const *publishes;
    void *state;
    void (*tick)(mb_moment *moment, void *state);
    void (*save)(const void *state, mb_map *saved); /* for a successor; NULL: nothing */
    void (*restore)(void *state, const mb_value *saved);
    void (*report)(const void *state, mb_map *figures); /* for the summary; NULL: nothing */
} mb_generator;

/* Takes part as a generator until the world ends; the exit code of the program. World, endpoint and
 * name are in MINERVA_WORLD, MINERVA_CONNECT and MINERVA_NAME, as the launcher sets them. */
int mb_run_generator(const mb_generator *generator);

/* A node of a string in reading order. */
typedef struct mb_node {
    mb_value symbol;
    mb_value id;            /* of an agent; else nil */
    const mb_value *values; /* in the order of the vocabulary; NULL: a slot */
    size_t value_count;
    size_t depth; /* number of nodes around it */
} mb_node;

typedef struct mb_view {
    const char *type;
    int64_t frame;
    const mb_node *nodes;
    size_t count;
    mb_value halted; /* ids of agents whose steps do not count in this frame */
} mb_view;

/* A device. */
typedef struct mb_device {
    const char *service;
    const char *const *draws; /* visual event types */
    const char *when;         /* "each 10 frames", "at 25 Hz": it requests its views itself; or NULL */
    bool coupled;             /* it draws every frame before the next one begins */
    void *state;
    void (*draw)(const mb_view *view, void *state);
    void (*report)(const void *state, mb_map *figures);
} mb_device;

/* Takes part as a device until the world ends; the exit code of the program. */
int mb_run_device(const mb_device *device);

#endif
