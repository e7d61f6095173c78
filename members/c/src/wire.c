#include "wire.h"

#include <string.h>

enum {
    VERSION = 9,
    CLIENT = 0x02,
    RESOLUTIONS = 0x0a, /* sequence numbers and request ids of 32 bits */
    SEQUENCE_MASK = 0x0fffffff,
    BLOCK_AT_DATA_PRIORITY = 0x0d,
    FRAME_ROOM = 6, /* a header and a sequence number of at most five bytes */
};

enum { INIT = 0x01, OPEN, CLOSE, KEEP_ALIVE, FRAME, FRAGMENT };
enum { LAST_TRANSPORT = 0x07 }; /* JOIN, between routers */
enum { INTEREST = 0x19, PUSH = 0x1d, DECLARE = 0x1e, OAM = 0x1f };
enum { NAMED = 0x20, RELIABLE = 0x20, MORE = 0x40, EXTENSIONS = 0x80 };
enum { TYPE = 0x1f };

/* --- writing --- */

static void write_number(mb_buffer *out, uint64_t number) {
    for (; number >= 0x80; number >>= 7) mb_add_byte(out, (uint8_t)(number | 0x80));
    mb_add_byte(out, (uint8_t)number);
}

static void write_slice(mb_buffer *out, const void *data, size_t size) {
    write_number(out, size);
    mb_add(out, data, size);
}

static void write_key(mb_buffer *out, const char *key) {
    mb_add_byte(out, 0);
    write_slice(out, key, strlen(key));
}

void mb_wire_init(mb_buffer *out, const uint8_t id[MB_ID_BYTES]) {
    mb_add(out, (uint8_t[]){INIT | 0x40, VERSION, (MB_ID_BYTES - 1) << 4 | CLIENT}, 3);
    mb_add(out, id, MB_ID_BYTES);
    mb_add(out, (uint8_t[]){RESOLUTIONS, MB_LONGEST_BATCH & 0xff, MB_LONGEST_BATCH >> 8}, 3);
}

void mb_wire_open(mb_buffer *out, uint64_t lease, uint64_t sequence, const uint8_t *cookie, size_t size) {
    mb_add_byte(out, OPEN | 0x40);
    write_number(out, lease);
    write_number(out, sequence);
    write_slice(out, cookie, size);
}

void mb_wire_keep_alive(mb_buffer *out) { mb_add_byte(out, KEEP_ALIVE); }

void mb_wire_close(mb_buffer *out) { mb_add(out, (uint8_t[]){CLOSE | 0x20, 0}, 2); }

void mb_wire_put(mb_buffer *out, const char *key, const void *payload, size_t size) {
    mb_add_byte(out, PUSH | NAMED | EXTENSIONS);
    write_key(out, key);
    mb_add(out, (uint8_t[]){0x21, BLOCK_AT_DATA_PRIORITY, 0x01}, 3);
    write_slice(out, payload, size);
}

static void write_declaration(mb_buffer *out, uint8_t type, uint64_t number, const char *key) {
    mb_add(out, (uint8_t[]){DECLARE, type | NAMED}, 2);
    write_number(out, number);
    write_key(out, key);
}

void mb_wire_subscriber(mb_buffer *out, uint64_t number, const char *key) { write_declaration(out, 0x02, number, key); }

void mb_wire_token(mb_buffer *out, uint64_t number, const char *key) { write_declaration(out, 0x06, number, key); }

void mb_wire_no_token(mb_buffer *out, uint64_t number) {
    mb_add(out, (uint8_t[]){DECLARE, 0x07}, 2);
    write_number(out, number);
}

void mb_wire_interest(mb_buffer *out, uint64_t number, const char *key, bool future) {
    mb_add_byte(out, (uint8_t)(INTEREST | 0x20 | (future ? 0x40 : 0)));
    write_number(out, number);
    mb_add_byte(out, 0x39); /* mappings and tokens of a key with a text */
    write_key(out, key);
}

static void write_batch(mb_buffer *out, uint8_t header, uint64_t sequence, const uint8_t *data, size_t size) {
    const size_t start = out->size;
    mb_add(out, (uint8_t[]){0, 0, header}, 3);
    write_number(out, sequence);
    mb_add(out, data, size);
    const size_t length = out->size - start - 2;
    out->data[start] = (uint8_t)length;
    out->data[start + 1] = (uint8_t)(length >> 8);
}

void mb_wire_batches(mb_buffer *out, const mb_buffer *message, uint64_t *sequence, size_t batch_size) {
    const size_t room = batch_size - FRAME_ROOM;
    const uint8_t type = message->size <= room ? FRAME : FRAGMENT;
    for (size_t at = 0; at < message->size; at += room) {
        const size_t rest = message->size - at, size = rest < room ? rest : room;
        const uint8_t more = size < rest ? MORE : 0;
        write_batch(out, type | RELIABLE | more, *sequence, message->data + at, size);
        *sequence = (*sequence + 1) & SEQUENCE_MASK;
    }
}

/* --- reading --- */

/* Reads from `at`; once something is missing, `is_cut` is true and everything else is empty. */
typedef struct reader {
    const uint8_t *at;
    const uint8_t *end;
    bool is_cut;
} reader;

typedef struct slice {
    const uint8_t *data;
    size_t size;
} slice;

static slice take(reader *in, uint64_t size) {
    if (size > (uint64_t)(in->end - in->at)) {
        in->is_cut = true;
        in->at = in->end;
        return (slice){in->end, 0};
    }
    in->at += size;
    return (slice){in->at - size, (size_t)size};
}

static uint8_t read_byte(reader *in) {
    const slice byte = take(in, 1);
    return byte.size == 1 ? *byte.data : 0;
}

static uint64_t read_number(reader *in) {
    uint64_t number = 0;
    for (int shift = 0; shift < 64; shift += 7) {
        const uint8_t byte = read_byte(in);
        number |= (uint64_t)(byte & 0x7f) << shift;
        if (byte < 0x80) return number;
    }
    in->is_cut = true;
    return 0;
}

static slice read_slice(reader *in) { return take(in, read_number(in)); }

static slice read_rest(reader *in) { return take(in, (uint64_t)(in->end - in->at)); }

/* Skips extensions, if the header announces any. `key` gets the one that names what is undeclared. */
static void skip_extensions(reader *in, uint8_t header, slice *key) {
    for (bool more = header & EXTENSIONS; more && !in->is_cut;) {
        const uint8_t head = read_byte(in);
        const uint8_t form = head & 0x60;
        if (form == 0x20) read_number(in);
        else if (form == 0x40) {
            const slice body = read_slice(in);
            if (key != NULL && (head & 0x0f) == 0x0f) *key = body;
        } else if (form == 0x60) in->is_cut = true;
        more = head & 0x80;
    }
}

static void read_key(reader *in, uint8_t header, mb_message *message) {
    message->has_key = true;
    message->mapping = read_number(in);
    const slice suffix = header & NAMED ? read_slice(in) : (slice){NULL, 0};
    message->suffix = (const char *)suffix.data;
    message->suffix_size = suffix.size;
}

static void read_init(reader *in, uint8_t header, mb_batch *batch) {
    read_byte(in);
    take(in, (uint64_t)(read_byte(in) >> 4) + 1);
    batch->batch_size = MB_LONGEST_BATCH;
    if (header & 0x40) {
        read_byte(in);
        batch->batch_size = read_byte(in);
        batch->batch_size |= (size_t)read_byte(in) << 8;
    }
    const slice cookie = read_slice(in);
    batch->cookie = cookie.data;
    batch->cookie_size = cookie.size;
}

static void read_body(reader *in, mb_batch *batch) {
    const slice body = read_rest(in);
    batch->body = body.data;
    batch->size = body.size;
}

bool mb_wire_batch(const uint8_t *data, size_t size, mb_batch *batch) {
    reader in = {data, data + size, false};
    const uint8_t header = read_byte(&in);
    *batch = (mb_batch){0};
    switch (header & TYPE) {
        case INIT:
            batch->type = MB_INIT;
            read_init(&in, header, batch);
            break;
        case OPEN:
            batch->type = MB_OPEN;
            batch->lease = read_number(&in) * (header & 0x40 ? 1000 : 1);
            break;
        case CLOSE: batch->type = MB_CLOSE; break;
        case KEEP_ALIVE:
            batch->type = MB_KEEP_ALIVE;
            skip_extensions(&in, header, NULL);
            read_body(&in, batch);
            break;
        case FRAME:
        case FRAGMENT:
            batch->type = (header & TYPE) == FRAME ? MB_FRAME : MB_FRAGMENT;
            batch->more = header & MORE;
            read_number(&in);
            skip_extensions(&in, header, NULL);
            read_body(&in, batch);
            break;
        default: return mb_refuse("Zenoh's transport message %d is unknown", header & TYPE);
    }
    return !in.is_cut || mb_refuse("a message of Zenoh is cut off");
}

bool mb_wire_is_transport(uint8_t header) { return (header & TYPE) <= LAST_TRANSPORT; }

static void read_push(reader *in, uint8_t header, mb_message *message) {
    read_key(in, header, message);
    skip_extensions(in, header, NULL);
    const uint8_t body = read_byte(in);
    const bool is_put = (body & TYPE) == 0x01;
    if (body & 0x20) {
        read_number(in);
        read_slice(in);
    }
    if (is_put && body & 0x40 && read_number(in) & 1) read_slice(in);
    skip_extensions(in, body, NULL);
    if (!is_put) return;
    const slice payload = read_slice(in);
    message->type = MB_PUT;
    message->payload = payload.data;
    message->payload_size = payload.size;
}

/* An undeclaration may have the key of what it undeclares: flags, mapping, and the text to the end. */
static void read_undeclared_key(slice body, mb_message *message) {
    reader in = {body.data, body.data + body.size, false};
    const uint8_t flags = read_byte(&in);
    message->has_key = true;
    message->mapping = read_number(&in);
    const slice suffix = flags & 0x01 ? read_rest(&in) : (slice){NULL, 0};
    message->suffix = (const char *)suffix.data;
    message->suffix_size = suffix.size;
}

static bool read_declaration(reader *in, uint8_t header, mb_message *message) {
    static const mb_network types[] = {MB_KEY,   MB_NO_KEY, MB_OTHER, MB_OTHER,
                                       MB_OTHER, MB_OTHER,  MB_TOKEN, MB_NO_TOKEN};
    message->is_answer = header & 0x20;
    if (message->is_answer) message->interest = read_number(in);
    skip_extensions(in, header, NULL);
    const uint8_t head = read_byte(in), id = head & TYPE;
    if (id == 0x1a) {
        skip_extensions(in, head, NULL);
        message->type = MB_FINAL;
        return true;
    }
    if (id > 0x07) return mb_refuse("Zenoh's declaration %d is unknown", id);
    message->type = types[id];
    message->number = read_number(in);
    if (id % 2 == 0) read_key(in, head, message);
    slice undeclared = {NULL, 0};
    skip_extensions(in, head, &undeclared);
    if (undeclared.data != NULL) read_undeclared_key(undeclared, message);
    return true;
}

static void skip_interest(reader *in, uint8_t header) {
    mb_message ignored = {0};
    read_number(in);
    if (header & 0x60) {
        const uint8_t options = read_byte(in);
        if (options & 0x10) read_key(in, options, &ignored);
    }
    skip_extensions(in, header, NULL);
}

static void skip_administration(reader *in, uint8_t header) {
    read_number(in);
    skip_extensions(in, header, NULL);
    const uint8_t form = header & 0x60;
    if (form == 0x20) read_number(in);
    else if (form == 0x40) read_slice(in);
}

bool mb_wire_message(const uint8_t **at, const uint8_t *end, mb_message *message) {
    reader in = {*at, end, false};
    const uint8_t header = read_byte(&in);
    bool is_known = true;
    *message = (mb_message){.type = MB_OTHER};
    switch (header & TYPE) {
        case PUSH: read_push(&in, header, message); break;
        case DECLARE: is_known = read_declaration(&in, header, message); break;
        case INTEREST: skip_interest(&in, header); break;
        case OAM: skip_administration(&in, header); break;
        /* Queries: a member declares no queryable, so none follows. The rest cannot be read. */
        default: return mb_refuse("Zenoh's network message %d is unknown", header & TYPE);
    }
    *at = in.at;
    return is_known && (!in.is_cut || mb_refuse("a message of Zenoh is cut off"));
}
