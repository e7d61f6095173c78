/* The protocol of a member as a state machine, without sockets and clocks (PROTOCOL.md, section 6). */

#ifndef MB_MEMBER_H
#define MB_MEMBER_H

#include "scene.h"

/* What a role declares. */
typedef struct mb_hello {
    const char *service;
    const char *const *generates;
    const char *const *orders;
    const char *const *draws;
    const char *const *topics;
    const char *const *publishes;
    const char *when; /* NULL: "" */
    bool coupled, ticks;
} mb_hello;

typedef struct mb_member mb_member;

/* What a member does after its welcome. Functions return false, with a problem, for a message that
 * cannot be read. */
typedef struct mb_role {
    mb_hello hello;
    void *self;
    void (*welcome)(void *self, mb_member *member, const mb_value *saved, bool is_again);
    bool (*receive)(void *self, mb_member *member, const mb_value *message); /* name and items, checked */
    bool (*readings)(void *self, mb_member *member, const char *topic, const char *publisher, const mb_value *message);
    void (*report)(void *self, mb_map *figures);
} mb_role;

/* What a member does outside; `self` is the first argument of each. */
typedef struct mb_outside {
    void *self;
    void (*put)(void *self, const char *key, const void *data, size_t size); /* after minerva/<world>/ */
    void (*log)(void *self, const char *text);
    bool (*is_released)(void *self); /* whether it has undeclared its token */
    void (*release)(void *self);
    void (*rejoin)(void *self);                       /* declare it again once the name is free */
    void (*wait)(void *self, int seconds, int code);  /* end in so many seconds; 0: not at all */
    void (*end)(void *self, int code);
} mb_outside;

struct mb_member {
    const char *name;
    mb_role role;
    mb_outside outside;
    mb_vocabulary vocabulary;
    int64_t epoch, seed, frame; /* `frame`: the one of the welcome */
    int64_t asked_for;          /* the frame of the last request; -1 before the first */
    double dt;
    bool has_joined, obeys, has_coordinator, is_stopping;
};

/* A member before its greeting. */
mb_member mb_member_of(const char *name, mb_role role, mb_outside outside);

/* Its subscriptions, after minerva/<world>/: calls `subscribe` with each. */
void mb_member_subscribe(const mb_member *member, void (*subscribe)(void *self, const char *key));

/* Its token is declared: for the first time, or again. */
void mb_member_begin(mb_member *member);

/* A message on a key after minerva/<world>/. One that cannot be read is dropped. */
void mb_member_receive(mb_member *member, const char *key, const uint8_t *data, size_t size);

/* The coordinator's token has appeared or vanished. */
void mb_member_coordinator(mb_member *member, bool is_there);

/* Sends the message in `body` to the coordinator. */
void mb_member_send(mb_member *member, const mb_buffer *body);

/* Publishes the readings in `body`. */
void mb_member_publish(mb_member *member, const char *topic, const mb_buffer *body);

/* Leaves the world. */
void mb_member_leave(mb_member *member);

/* Its own code has failed: it ends. */
void mb_member_fail(mb_member *member, const char *problem);

/* Runs a member until its world ends; its exit code. */
int mb_run(mb_role role);

#endif
