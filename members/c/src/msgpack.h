/* MessagePack: plain values, their bytes, and buffers that grow. */

#ifndef MB_MSGPACK_H
#define MB_MSGPACK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Bytes of a message at most (PROTOCOL.md, section 14). */
#define MB_MESSAGE_BYTES ((size_t)64 * 1024 * 1024)

typedef enum mb_type {
    MB_NIL,
    MB_BOOL,
    MB_INT,
    MB_UINT, /* an integer above INT64_MAX */
    MB_REAL,
    MB_TEXT,
    MB_BYTES,
    MB_LIST,
    MB_MAP,
    MB_EXTENSION
} mb_type;

/* A value. It does not own what it points to. */
typedef struct mb_value mb_value;
struct mb_value {
    mb_type type;
    int8_t extension; /* type of an extension */
    size_t size;      /* bytes of a text, of bytes or an extension; items of a list; pairs of a map */
    union {
        bool boolean;
        int64_t integer;
        uint64_t large; /* of MB_UINT */
        double real;
        const char *text; /* UTF-8, without a zero byte at its end */
        const uint8_t *bytes;
        const mb_value *items; /* of a map: key, value, key, value, ... */
    };
};

mb_value mb_nil(void);
mb_value mb_bool(bool value);
mb_value mb_int(int64_t value);
mb_value mb_real(double value);
mb_value mb_text(const char *text);
mb_value mb_list(const mb_value *items, size_t count);

/* Whether a value is this text. */
bool mb_is(const mb_value *value, const char *text);

/* Whether two texts are equal. */
bool mb_same_text(const mb_value *a, const mb_value *b);

/* The number of a real or an integer; 0 for anything else. */
double mb_number(const mb_value *value);

/* The value of a key of a map; NULL if there is none. */
const mb_value *mb_find(const mb_value *map, const char *key);

/* --- buffers --- */

typedef struct mb_buffer {
    uint8_t *data;
    size_t size;
    size_t room;
} mb_buffer;

void mb_add(mb_buffer *buffer, const void *data, size_t size);
void mb_add_byte(mb_buffer *buffer, uint8_t byte);
void mb_free(mb_buffer *buffer);

/* Memory of `count` items of `size` bytes, which replaces `old`. Ends the program if there is none. */
void *mb_resize(void *old, size_t count, size_t size);

/* --- writing: the shortest form --- */

void mb_write(mb_buffer *out, const mb_value *value);
void mb_write_int(mb_buffer *out, int64_t value);
void mb_write_text(mb_buffer *out, const char *text);
void mb_write_list(mb_buffer *out, size_t count); /* its items follow */
void mb_write_map(mb_buffer *out, size_t count);  /* its keys and values follow */

/* A map whose entries are not counted before they are written. */
typedef struct mb_map {
    mb_buffer entries;
    size_t count;
} mb_map;

void mb_set(mb_map *map, const char *key, mb_value value);

/* Writes a map and empties it. */
void mb_finish_map(mb_buffer *out, mb_map *map);

/* --- reading --- */

/* A value with the memory of its lists. Texts and bytes point into the data that it was read from. */
typedef struct mb_document {
    mb_value root;
    void *blocks;
    uint8_t *own; /* data that it has copied; NULL: the caller's data */
} mb_document;

/* Reads the value at the beginning of `data`; false, with a problem, if there is none.
 * `used` gets its number of bytes; if it is NULL, nothing may follow the value. */
bool mb_read(mb_document *document, const uint8_t *data, size_t size, size_t *used);

/* A document with a copy of a value. */
mb_document mb_copy(const mb_value *value);

void mb_release(mb_document *document);

/* --- problems --- */

/* Sets the text of the problem, as printf does; returns false. */
bool mb_refuse(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Why the last function that returned false has failed. */
const char *mb_problem(void);

#endif
