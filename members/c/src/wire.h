/* Zenoh's messages as bytes, as far as a client in the members' role needs them (docs/reference/protocol/zenoh-wire.md). */

#ifndef MB_WIRE_H
#define MB_WIRE_H

#include "msgpack.h"

enum { MB_LONGEST_BATCH = 0xffff, MB_ID_BYTES = 16, MB_LONGEST_KEY = 512 };

/* --- writing: each adds a message to a buffer --- */

void mb_wire_init(mb_buffer *out, const uint8_t id[MB_ID_BYTES]);
void mb_wire_open(mb_buffer *out, uint64_t lease, uint64_t sequence, const uint8_t *cookie, size_t size);
void mb_wire_keep_alive(mb_buffer *out);
void mb_wire_close(mb_buffer *out);

void mb_wire_put(mb_buffer *out, const char *key, const void *payload, size_t size);
void mb_wire_subscriber(mb_buffer *out, uint64_t number, const char *key);
void mb_wire_token(mb_buffer *out, uint64_t number, const char *key);
void mb_wire_no_token(mb_buffer *out, uint64_t number);

/* INTEREST in the tokens of a key: those that exist, and with `future` those to come. */
void mb_wire_interest(mb_buffer *out, uint64_t number, const char *key, bool future);

/* Adds the batches that carry a network message, each after its length: one FRAME, or FRAGMENTs. */
void mb_wire_batches(mb_buffer *out, const mb_buffer *message, uint64_t *sequence, size_t batch_size);

/* --- reading --- */

typedef enum mb_transport { MB_INIT, MB_OPEN, MB_CLOSE, MB_KEEP_ALIVE, MB_FRAME, MB_FRAGMENT } mb_transport;

typedef struct mb_batch {
    mb_transport type;
    const uint8_t *body; /* of a FRAME or FRAGMENT; after a KEEP_ALIVE the next message, if any */
    size_t size;
    bool more;           /* of a FRAGMENT: others follow */
    size_t batch_size;   /* of INIT */
    const uint8_t *cookie;
    size_t cookie_size;
    uint64_t lease; /* of OPEN, in milliseconds */
} mb_batch;

/* False, with a problem, if the bytes are no transport message of a router. */
bool mb_wire_batch(const uint8_t *data, size_t size, mb_batch *batch);

/* Whether a header begins a transport message, which may follow the network messages of a FRAME in its batch. */
bool mb_wire_is_transport(uint8_t header);

typedef enum mb_network {
    MB_PUT,
    MB_KEY,       /* a mapping is declared */
    MB_NO_KEY,
    MB_TOKEN,
    MB_NO_TOKEN,
    MB_FINAL,     /* the answer to an INTEREST is complete */
    MB_OTHER      /* of no concern to a member */
} mb_network;

typedef struct mb_message {
    mb_network type;
    bool is_answer;    /* of a declaration: to an INTEREST, */
    uint64_t interest; /* with this number */
    uint64_t number;   /* of a declaration */
    bool has_key;
    uint64_t mapping;
    const char *suffix;
    size_t suffix_size;
    const uint8_t *payload;
    size_t payload_size;
} mb_message;

/* Reads the message at `*at` and moves it forward; false, with a problem, if it is not known. */
bool mb_wire_message(const uint8_t **at, const uint8_t *end, mb_message *message);

#endif
