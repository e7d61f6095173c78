/* Runs a member over a Zenoh session until its world ends. */

#define _POSIX_C_SOURCE 200809L

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "member.h"
#include "session.h"
#include "wire.h"

/* Times in milliseconds. */
enum { TAKEN = 2000, TAKEN_AGAIN = 4000, POLL = 50, STEP = 500 };

/* How far it is with the token of its name. */
typedef enum naming { RELEASED, ASKING, PAUSING, NAMED } naming;

typedef struct process {
    mb_session *session;
    mb_member member;
    const char *name;
    char prefix[MB_LONGEST_KEY / 4], coordinator[MB_LONGEST_KEY], alive[MB_LONGEST_KEY];
    naming naming;
    bool is_declared; /* whether it has declared its subscriptions */
    int64_t name_until, ask_at; /* until when to ask for the name, and when next */
    bool is_waiting;
    int64_t wait_until;
    int wait_seconds, wait_code;
    bool is_over;
    int code;
} process;

static volatile sig_atomic_t is_interrupted;

static void interrupt(int number) {
    (void)number;
    is_interrupted = 1;
}

static void print(const char *name, const char *text) { fprintf(stderr, "%s: %s\n", name, text); }

/* --- what the member does outside --- */

static const char *key_of(const process *self, const char *rest, char key[MB_LONGEST_KEY]) {
    snprintf(key, MB_LONGEST_KEY, "%s%s", self->prefix, rest);
    return key;
}

static void put(void *outside, const char *rest, const void *data, size_t size) {
    process *self = outside;
    char key[MB_LONGEST_KEY];
    mb_session_put(self->session, key_of(self, rest, key), data, size);
}

static void write_log(void *outside, const char *text) { print(((process *)outside)->name, text); }

static bool is_released(void *outside) { return ((process *)outside)->naming != NAMED; }

static void release(void *outside) {
    process *self = outside;
    mb_session_undeclare_token(self->session);
    self->naming = RELEASED;
}

static void wait_for(void *outside, int seconds, int code) {
    process *self = outside;
    self->is_waiting = seconds > 0;
    self->wait_until = mb_now() + 1000 * (int64_t)seconds;
    self->wait_seconds = seconds;
    self->wait_code = code;
}

static void end(void *outside, int code) {
    process *self = outside;
    if (self->is_over) return;
    self->is_over = true;
    self->code = code;
}

/* --- the name --- */

static void ask_for_name(process *self) {
    self->naming = mb_session_query(self->session, self->alive) ? ASKING : PAUSING;
    self->ask_at = mb_now() + POLL;
}

static void take_name(process *self, int milliseconds) {
    self->name_until = mb_now() + milliseconds;
    ask_for_name(self);
}

static void rejoin(void *outside) {
    process *self = outside;
    wait_for(self, 0, 0);
    if (self->naming == RELEASED) take_name(self, TAKEN_AGAIN);
}

static void subscribe(void *outside, const char *rest) {
    char key[MB_LONGEST_KEY];
    process *self = outside;
    mb_session_subscribe(self->session, key_of(self, rest, key));
}

/* Subscriptions and the watch of the coordinator come first, the token last (P6.3 to P6.5). */
static void declare(process *self) {
    if (!self->is_declared) {
        mb_member_subscribe(&self->member, subscribe);
        mb_session_watch(self->session, self->coordinator);
    }
    self->is_declared = true;
    self->naming = NAMED;
    mb_session_declare_token(self->session, self->alive);
    mb_member_begin(&self->member);
}

static void on_tokens(void *listener, size_t count) {
    process *self = listener;
    if (self->naming != ASKING) return;
    if (count == 0) {
        declare(self);
    } else if (mb_now() > self->name_until) {
        print(self->name, "another member has this name");
        end(self, 1);
    } else {
        self->naming = PAUSING;
    }
}

/* --- the session --- */

static void on_sample(void *listener, const char *key, const uint8_t *payload, size_t size) {
    process *self = listener;
    const size_t prefix = strlen(self->prefix);
    if (!self->is_over && strncmp(key, self->prefix, prefix) == 0)
        mb_member_receive(&self->member, key + prefix, payload, size);
}

static void on_token(void *listener, const char *key, bool is_alive) {
    process *self = listener;
    if (!self->is_over && strcmp(key, self->coordinator) == 0) mb_member_coordinator(&self->member, is_alive);
}

static void on_problem(void *listener) {
    char text[320];
    snprintf(text, sizeof text, "dropped a message of the bus: %s", mb_problem());
    print(((process *)listener)->name, text);
}

static void check_clock(process *self) {
    const int64_t now = mb_now();
    if (is_interrupted) mb_member_leave(&self->member);
    else if (self->is_waiting && now >= self->wait_until) {
        if (self->wait_code != 0) fprintf(stderr, "%s: no coordinator for %d s\n", self->name, self->wait_seconds);
        end(self, self->wait_code);
    } else if (self->naming == PAUSING && now >= self->ask_at) {
        ask_for_name(self);
    }
}

/* Milliseconds until the clock has to be checked again. */
static int pause_of(const process *self) {
    int64_t pause = STEP;
    const int64_t now = mb_now();
    if (self->is_waiting && self->wait_until - now < pause) pause = self->wait_until - now;
    if (self->naming == PAUSING && self->ask_at - now < pause) pause = self->ask_at - now;
    return pause > 0 ? (int)pause : 0;
}

static void take_part(process *self) {
    take_name(self, TAKEN);
    while (!self->is_over) {
        mb_session_step(self->session, pause_of(self));
        if (!self->is_over) check_clock(self);
    }
    release(self);
    mb_session_close(self->session);
    mb_release(&self->member.vocabulary.document);
}

/* A variable of the environment; NULL, after a message, if it is not set. */
static const char *setting(const char *variable) {
    const char *value = getenv(variable);
    if (value != NULL && *value != 0) return value;
    fprintf(stderr, "%s is not set; start this program by a world file, or set it\n", variable);
    return NULL;
}

static bool check_name(const char *variable, const char *name) {
    if (mb_is_name(name)) return true;
    fprintf(stderr, "%s is not a name of 1 to 64 letters, digits and _ . ~ -\n", variable);
    return false;
}

static void listen_to_signals(void) {
    struct sigaction action = {.sa_handler = interrupt};
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}

int mb_run(mb_role role) {
    const char *world = setting("MINERVA_WORLD"), *name = world == NULL ? NULL : setting("MINERVA_NAME");
    const char *endpoint = name == NULL ? NULL : setting("MINERVA_CONNECT");
    if (endpoint == NULL || !check_name("MINERVA_WORLD", world) || !check_name("MINERVA_NAME", name)) return 1;
    process self = {.name = name};
    snprintf(self.prefix, sizeof self.prefix, "minerva/%s/", world);
    snprintf(self.coordinator, sizeof self.coordinator, "%salive/coordinator", self.prefix);
    snprintf(self.alive, sizeof self.alive, "%salive/%s", self.prefix, name);
    const mb_outside outside = {&self, put, write_log, is_released, release, rejoin, wait_for, end};
    self.member = mb_member_of(name, role, outside);
    self.session = mb_session_open(endpoint, (mb_listener){&self, on_sample, on_token, on_tokens, on_problem});
    if (self.session == NULL) {
        fprintf(stderr, "%s: %s: no world at %s\n", name, mb_problem(), endpoint);
        return 1;
    }
    listen_to_signals();
    take_part(&self);
    return self.code;
}
