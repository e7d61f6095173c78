#define _POSIX_C_SOURCE 200809L

#include "session.h"

#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "wire.h"

enum {
    LEASE_SECONDS = 3,
    OPENING = 5000, /* milliseconds, as all times */
    FIRST_RETRY = 50,
    LONGEST_RETRY = 500,
    LEAST_BATCH = 64,
    MAX_MAPPINGS = 0x10000,
    MAX_TOKENS = 1024,
    MAX_DECLARATIONS = 256,
};
static const size_t LARGEST = MB_MESSAGE_BYTES + 0x10000; /* a fragmented message */

typedef struct token {
    uint64_t number;
    char *key;
} token;

struct mb_session {
    mb_listener listener;
    char host[256], port[16];
    uint8_t id[MB_ID_BYTES];

    int socket; /* -1: no link */
    size_t batch_size;
    uint64_t sequence;
    int64_t lease, received_at, sent_at, retry_at, retry;
    mb_buffer input, fragments;
    bool is_too_large; /* the fragmented message that is being received */

    mb_buffer declared[MAX_DECLARATIONS];
    size_t declared_count;
    uint64_t number;       /* of the last declaration */
    uint64_t token_number; /* 0: none */
    uint64_t query;        /* 0: none */
    size_t query_count;

    char **mappings;
    size_t mapping_count;
    token tokens[MAX_TOKENS];
    size_t token_count;
};

int64_t mb_now(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (int64_t)time.tv_sec * 1000 + time.tv_nsec / 1000000;
}

static char *copied(const char *text) { return strcpy(mb_resize(NULL, strlen(text) + 1, 1), text); }

/* --- the link --- */

static bool parse_endpoint(mb_session *session, const char *endpoint) {
    if (strncmp(endpoint, "tcp/", 4) != 0) return mb_refuse("expected tcp/HOST:PORT");
    const char *host = endpoint + 4, *colon = strrchr(host, ':');
    if (colon == NULL || colon == host) return mb_refuse("expected tcp/HOST:PORT");
    size_t size = (size_t)(colon - host);
    if (host[0] == '[' && colon[-1] == ']') {
        host++;
        size -= 2;
    }
    if (size >= sizeof session->host || strlen(colon + 1) >= sizeof session->port)
        return mb_refuse("expected tcp/HOST:PORT");
    memcpy(session->host, host, size);
    strcpy(session->port, colon + 1);
    return true;
}

static bool await(int socket, short events, int64_t until) {
    for (;;) {
        const int64_t rest = until - mb_now();
        struct pollfd wanted = {.fd = socket, .events = events};
        const int ready = poll(&wanted, 1, rest > 0 ? (int)rest : 0);
        if (ready > 0) return true;
        if (ready == 0) return mb_refuse("no answer within %d s", OPENING / 1000);
        if (errno != EINTR) return mb_refuse("%s", strerror(errno));
    }
}

static int connected(const struct addrinfo *address, int64_t until) {
    const int link = socket(address->ai_family, address->ai_socktype, address->ai_protocol);
    if (link < 0) return -1;
    fcntl(link, F_SETFL, O_NONBLOCK);
    fcntl(link, F_SETFD, FD_CLOEXEC);
    int error = connect(link, address->ai_addr, address->ai_addrlen) == 0 ? 0 : errno;
    socklen_t size = sizeof error;
    if (error == EINPROGRESS && await(link, POLLOUT, until)) getsockopt(link, SOL_SOCKET, SO_ERROR, &error, &size);
    if (error == 0) {
        setsockopt(link, IPPROTO_TCP, TCP_NODELAY, &(int){1}, sizeof(int));
        return link;
    }
    mb_refuse("%s", strerror(error));
    close(link);
    return -1;
}

static bool open_link(mb_session *session, int64_t until) {
    const struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM};
    struct addrinfo *addresses = NULL;
    const int error = getaddrinfo(session->host, session->port, &hints, &addresses);
    if (error != 0) return mb_refuse("%s", gai_strerror(error));
    for (struct addrinfo *at = addresses; at != NULL && session->socket < 0; at = at->ai_next)
        session->socket = connected(at, until);
    freeaddrinfo(addresses);
    return session->socket >= 0;
}

static bool send_all(mb_session *session, const mb_buffer *data) {
    const int64_t until = mb_now() + 1000 * LEASE_SECONDS;
    for (size_t at = 0; at < data->size;) {
        const ssize_t sent = send(session->socket, data->data + at, data->size - at, MSG_NOSIGNAL);
        if (sent >= 0) at += (size_t)sent;
        else if (errno != EAGAIN && errno != EINTR) return mb_refuse("%s", strerror(errno));
        else if (!await(session->socket, POLLOUT, until)) return false;
    }
    session->sent_at = mb_now();
    return true;
}

/* Sends a transport message. */
static bool send_transport(mb_session *session, const mb_buffer *message) {
    mb_buffer batch = {0};
    mb_add(&batch, (uint8_t[]){(uint8_t)message->size, (uint8_t)(message->size >> 8)}, 2);
    mb_add(&batch, message->data, message->size);
    const bool is_sent = send_all(session, &batch);
    mb_free(&batch);
    return is_sent;
}

/* Reads what has arrived; false if the link is closed. */
static bool receive_bytes(mb_session *session) {
    uint8_t data[0x10000];
    const ssize_t size = recv(session->socket, data, sizeof data, 0);
    if (size < 0) return errno == EAGAIN || errno == EINTR || mb_refuse("%s", strerror(errno));
    if (size == 0) return mb_refuse("the link was closed");
    mb_add(&session->input, data, (size_t)size);
    session->received_at = mb_now();
    return true;
}

/* The first whole batch that has arrived. */
static bool next_batch(const mb_session *session, size_t at, const uint8_t **data, size_t *size) {
    const size_t rest = session->input.size - at;
    if (rest < 2) return false;
    *data = session->input.data + at + 2;
    *size = (size_t)(*data)[-2] | (size_t)(*data)[-1] << 8;
    return rest - 2 >= *size;
}

static void forget_input(mb_session *session, size_t size) {
    mb_buffer *input = &session->input;
    if (size < input->size) memmove(input->data, input->data + size, input->size - size);
    input->size -= size;
}

/* --- opening --- */

static bool expect(mb_session *session, mb_transport type, int64_t until, mb_batch *batch, mb_buffer *copy) {
    const uint8_t *data;
    size_t size;
    while (!next_batch(session, 0, &data, &size))
        if (!await(session->socket, POLLIN, until) || !receive_bytes(session)) return false;
    mb_add(copy, data, size);
    forget_input(session, size + 2);
    if (!mb_wire_batch(copy->data, copy->size, batch)) return false;
    return batch->type == type || mb_refuse("the router refused the session");
}

static bool shake_hands(mb_session *session, int64_t until) {
    mb_buffer init = {0}, open = {0}, first = {0}, second = {0};
    mb_batch batch;
    mb_wire_init(&init, session->id);
    bool is_open = send_transport(session, &init) && expect(session, MB_INIT, until, &batch, &first);
    if (is_open) {
        session->batch_size = batch.batch_size < LEAST_BATCH ? LEAST_BATCH : batch.batch_size;
        mb_wire_open(&open, LEASE_SECONDS, session->sequence, batch.cookie, batch.cookie_size);
        is_open = send_transport(session, &open) && expect(session, MB_OPEN, until, &batch, &second);
    }
    if (is_open) session->lease = batch.lease > 0 && batch.lease < INT32_MAX ? (int64_t)batch.lease : 10000;
    for (mb_buffer *each[] = {&init, &open, &first, &second}, **at = each; at < each + 4; at++) mb_free(*at);
    return is_open;
}

static void send_network(mb_session *session, const mb_buffer *message);

static bool connect_session(mb_session *session) {
    const int64_t until = mb_now() + OPENING;
    session->input.size = 0;
    if (!open_link(session, until) || !shake_hands(session, until)) {
        if (session->socket >= 0) close(session->socket);
        session->socket = -1;
        return false;
    }
    session->received_at = mb_now();
    session->retry = FIRST_RETRY;
    for (size_t n = 0; n < session->declared_count; n++) send_network(session, &session->declared[n]);
    return true;
}

/* --- losing --- */

static void remove_token(mb_session *session, size_t place) {
    char *key = session->tokens[place].key;
    session->tokens[place] = session->tokens[--session->token_count];
    session->listener.on_token(session->listener.self, key, false);
    free(key);
}

static void forget_mappings(mb_session *session) {
    for (size_t n = 0; n < session->mapping_count; n++) free(session->mappings[n]);
    free(session->mappings);
    session->mappings = NULL;
    session->mapping_count = 0;
}

static void lose_link(mb_session *session) {
    if (session->socket < 0) return;
    close(session->socket);
    session->socket = -1;
    session->input.size = session->fragments.size = 0;
    session->retry_at = mb_now() + session->retry;
    forget_mappings(session);
    const bool was_asked = session->query != 0;
    session->query = 0;
    while (session->token_count > 0) remove_token(session, session->token_count - 1);
    /* The name may be held by another member: the answer is not known, so it counts as taken. */
    if (was_asked) session->listener.on_tokens(session->listener.self, 1);
}

static void send_network(mb_session *session, const mb_buffer *message) {
    if (session->socket < 0) return;
    mb_buffer batches = {0};
    mb_wire_batches(&batches, message, &session->sequence, session->batch_size);
    const bool is_sent = send_all(session, &batches);
    mb_free(&batches);
    if (!is_sent) lose_link(session);
}

/* --- what the router sends --- */

/* The key of a message in `text`; false if its mapping was not declared. */
static bool name_key(const mb_session *session, const mb_message *message, char text[MB_LONGEST_KEY]) {
    const char *stem = "";
    if (message->mapping != 0) {
        const bool is_known = message->mapping < session->mapping_count && session->mappings[message->mapping] != NULL;
        if (!is_known) return mb_refuse("a key that was not declared");
        stem = session->mappings[message->mapping];
    }
    const size_t size = strlen(stem);
    if (size + message->suffix_size >= MB_LONGEST_KEY) return mb_refuse("a key is too long");
    memcpy(text, stem, size);
    if (message->suffix_size > 0) memcpy(text + size, message->suffix, message->suffix_size);
    text[size + message->suffix_size] = 0;
    return true;
}

static bool set_mapping(mb_session *session, uint64_t number, const char *key) {
    if (number >= MAX_MAPPINGS) return mb_refuse("a mapping is out of range");
    while (session->mapping_count <= number) {
        session->mappings = mb_resize(session->mappings, session->mapping_count + 1, sizeof(char *));
        session->mappings[session->mapping_count++] = NULL;
    }
    free(session->mappings[number]);
    session->mappings[number] = key == NULL ? NULL : copied(key);
    return true;
}

static bool receive_token(mb_session *session, const mb_message *message, const char *key) {
    if (message->is_answer && message->interest == session->query) {
        session->query_count++;
        return true;
    }
    if (session->token_count == MAX_TOKENS) return mb_refuse("too many tokens");
    session->tokens[session->token_count++] = (token){message->number, copied(key)};
    session->listener.on_token(session->listener.self, key, true);
    return true;
}

static bool receive_no_token(mb_session *session, const mb_message *message) {
    char key[MB_LONGEST_KEY];
    for (size_t n = 0; n < session->token_count; n++)
        if (session->tokens[n].number == message->number) {
            remove_token(session, n);
            return true;
        }
    if (!message->has_key) return true;
    if (!name_key(session, message, key)) return false;
    session->listener.on_token(session->listener.self, key, false);
    return true;
}

static void receive_final(mb_session *session, const mb_message *message) {
    if (!message->is_answer || session->query == 0 || message->interest != session->query) return;
    session->query = 0;
    session->listener.on_tokens(session->listener.self, session->query_count);
}

static bool receive_message(mb_session *session, const mb_message *message) {
    char key[MB_LONGEST_KEY];
    switch (message->type) {
        case MB_PUT:
            if (!name_key(session, message, key)) return false;
            session->listener.on_sample(session->listener.self, key, message->payload, message->payload_size);
            return true;
        case MB_KEY: return name_key(session, message, key) && set_mapping(session, message->number, key);
        case MB_NO_KEY: return set_mapping(session, message->number, NULL);
        case MB_TOKEN: return name_key(session, message, key) && receive_token(session, message, key);
        case MB_NO_TOKEN: return receive_no_token(session, message);
        case MB_FINAL: receive_final(session, message); return true;
        case MB_OTHER: break;
    }
    return true;
}

/* Receives network messages, and advances to a transport message that follows them, or to the end. */
static bool receive_messages(mb_session *session, const uint8_t **at, const uint8_t *end) {
    mb_message message;
    while (*at < end && session->socket >= 0 && !mb_wire_is_transport(**at)) {
        if (!mb_wire_message(at, end, &message)) return false;
        if (!receive_message(session, &message)) session->listener.on_problem(session->listener.self);
    }
    return true;
}

static bool receive_fragment(mb_session *session, const mb_batch *batch) {
    mb_buffer *whole = &session->fragments;
    session->is_too_large = session->is_too_large || whole->size + batch->size > LARGEST;
    if (!session->is_too_large) mb_add(whole, batch->body, batch->size);
    if (batch->more) return true;
    const uint8_t *at = whole->data;
    const bool is_read = session->is_too_large ? mb_refuse("a message is too large")
                                               : receive_messages(session, &at, at + whole->size);
    mb_free(whole);
    session->is_too_large = false;
    return is_read;
}

static bool receive_batch(mb_session *session, const uint8_t *data, size_t size) {
    const uint8_t *at = data, *end = data + size;
    mb_batch batch;
    do {
        if (!mb_wire_batch(at, (size_t)(end - at), &batch)) return false;
        if (batch.type == MB_CLOSE) lose_link(session);
        if (batch.type == MB_FRAGMENT) return receive_fragment(session, &batch);
        if (batch.type != MB_FRAME && batch.type != MB_KEEP_ALIVE) return true;
        at = batch.body;
        if (batch.type == MB_FRAME && !receive_messages(session, &at, end)) return false;
    } while (at < end && session->socket >= 0);
    return true;
}

static void receive_batches(mb_session *session) {
    const uint8_t *data;
    size_t size, at = 0;
    while (session->socket >= 0 && next_batch(session, at, &data, &size)) {
        if (!receive_batch(session, data, size)) session->listener.on_problem(session->listener.self);
        at += size + 2;
    }
    if (session->socket >= 0) forget_input(session, at);
}

/* --- what a member does --- */

static bool make_id(uint8_t id[MB_ID_BYTES]) {
    FILE *random = fopen("/dev/urandom", "rb");
    const bool is_made = random != NULL && fread(id, 1, MB_ID_BYTES, random) == MB_ID_BYTES;
    if (random != NULL) fclose(random);
    return is_made || mb_refuse("/dev/urandom cannot be read");
}

mb_session *mb_session_open(const char *endpoint, mb_listener listener) {
    mb_session *session = mb_resize(NULL, 1, sizeof *session);
    *session = (mb_session){.listener = listener, .socket = -1};
    if (!parse_endpoint(session, endpoint) || !make_id(session->id) || !connect_session(session)) {
        mb_session_close(session);
        return NULL;
    }
    return session;
}

static void keep_alive(mb_session *session) {
    const int64_t now = mb_now();
    if (now - session->received_at > session->lease) {
        mb_refuse("the router is silent");
        lose_link(session);
    } else if (now - session->sent_at >= 1000 * LEASE_SECONDS / 4) {
        mb_buffer message = {0};
        mb_wire_keep_alive(&message);
        const bool is_sent = send_transport(session, &message);
        mb_free(&message);
        if (!is_sent) lose_link(session);
    }
}

static void reconnect(mb_session *session, int milliseconds) {
    const int64_t rest = session->retry_at - mb_now();
    const int64_t pause = rest < milliseconds ? rest : milliseconds;
    if (pause > 0) poll(NULL, 0, (int)pause);
    if (mb_now() < session->retry_at || connect_session(session)) return;
    session->retry = session->retry * 3 / 2 < LONGEST_RETRY ? session->retry * 3 / 2 : LONGEST_RETRY;
    session->retry_at = mb_now() + session->retry;
}

void mb_session_step(mb_session *session, int milliseconds) {
    if (session->socket < 0) {
        reconnect(session, milliseconds);
        return;
    }
    const int longest = 1000 * LEASE_SECONDS / 4;
    struct pollfd wanted = {.fd = session->socket, .events = POLLIN};
    const int ready = poll(&wanted, 1, milliseconds < longest ? milliseconds : longest);
    if (ready > 0 && !receive_bytes(session)) lose_link(session);
    receive_batches(session);
    if (session->socket >= 0) keep_alive(session);
}

void mb_session_put(mb_session *session, const char *key, const void *payload, size_t size) {
    mb_buffer message = {0};
    mb_wire_put(&message, key, payload, size);
    send_network(session, &message);
    mb_free(&message);
}

/* A new declaration, which is repeated after a lost link. */
static mb_buffer *next_declaration(mb_session *session) {
    if (session->declared_count == MAX_DECLARATIONS) {
        fputs("too many declarations\n", stderr);
        abort();
    }
    session->number++;
    session->declared[session->declared_count] = (mb_buffer){0};
    return &session->declared[session->declared_count++];
}

void mb_session_subscribe(mb_session *session, const char *key) {
    mb_buffer *message = next_declaration(session);
    mb_wire_subscriber(message, session->number, key);
    send_network(session, message);
}

void mb_session_watch(mb_session *session, const char *key) {
    mb_buffer *message = next_declaration(session);
    mb_wire_interest(message, session->number, key, true);
    send_network(session, message);
}

bool mb_session_query(mb_session *session, const char *key) {
    if (session->socket < 0) return false;
    mb_buffer message = {0};
    session->query = ++session->number;
    session->query_count = 0;
    mb_wire_interest(&message, session->query, key, false);
    send_network(session, &message);
    mb_free(&message);
    return true;
}

void mb_session_declare_token(mb_session *session, const char *key) {
    mb_buffer *message = next_declaration(session);
    session->token_number = session->number;
    mb_wire_token(message, session->number, key);
    send_network(session, message);
}

/* The token is always the last declaration. */
void mb_session_undeclare_token(mb_session *session) {
    if (session->token_number == 0) return;
    mb_buffer message = {0};
    mb_free(&session->declared[--session->declared_count]);
    mb_wire_no_token(&message, session->token_number);
    session->token_number = 0;
    send_network(session, &message);
    mb_free(&message);
}

void mb_session_close(mb_session *session) {
    if (session->socket >= 0) {
        mb_buffer message = {0};
        mb_wire_close(&message);
        send_transport(session, &message);
        mb_free(&message);
        close(session->socket);
    }
    for (size_t n = 0; n < session->declared_count; n++) mb_free(&session->declared[n]);
    for (size_t n = 0; n < session->token_count; n++) free(session->tokens[n].key);
    forget_mappings(session);
    mb_free(&session->input);
    mb_free(&session->fragments);
    free(session);
}
