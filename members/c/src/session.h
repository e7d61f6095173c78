/* A Zenoh session in client mode over TCP: publish, subscribe and liveliness, in one thread. */

#ifndef MB_SESSION_H
#define MB_SESSION_H

#include "msgpack.h"

/* What a session reports; `self` is the first argument of each. Keys end with a zero byte. */
typedef struct mb_listener {
    void *self;
    void (*on_sample)(void *self, const char *key, const uint8_t *payload, size_t size);
    void (*on_token)(void *self, const char *key, bool is_alive);
    void (*on_tokens)(void *self, size_t count); /* the answer to mb_session_query */
    void (*on_problem)(void *self);              /* mb_problem() says what could not be read */
} mb_listener;

typedef struct mb_session mb_session;

/* Opens a session at `tcp/HOST:PORT`. NULL, with a problem, if no router answers there within 5 s. */
mb_session *mb_session_open(const char *endpoint, mb_listener listener);

/* Waits for at most `milliseconds`, reports what has arrived, and keeps the session alive.
 * A lost link is opened again, with all declarations. */
void mb_session_step(mb_session *session, int milliseconds);

void mb_session_put(mb_session *session, const char *key, const void *payload, size_t size);
void mb_session_subscribe(mb_session *session, const char *key);

/* Watches the tokens of a key, those that exist included. */
void mb_session_watch(mb_session *session, const char *key);

/* Asks for the tokens of a key that exist now. False if there is no link: there will be no answer. */
bool mb_session_query(mb_session *session, const char *key);

void mb_session_declare_token(mb_session *session, const char *key);
void mb_session_undeclare_token(mb_session *session);
void mb_session_close(mb_session *session);

/* Milliseconds of a clock that never goes back. */
int64_t mb_now(void);

#endif
