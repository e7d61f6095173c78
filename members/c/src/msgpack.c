#include "msgpack.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { DEEPEST = 100, LEAST_ROOM = 256 };

static _Thread_local char problem[256];

bool mb_refuse(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(problem, sizeof problem, format, arguments);
    va_end(arguments);
    return false;
}

const char *mb_problem(void) { return problem; }

/* --- values --- */

mb_value mb_nil(void) { return (mb_value){.type = MB_NIL}; }
mb_value mb_bool(bool value) { return (mb_value){.type = MB_BOOL, .boolean = value}; }
mb_value mb_int(int64_t value) { return (mb_value){.type = MB_INT, .integer = value}; }
mb_value mb_real(double value) { return (mb_value){.type = MB_REAL, .real = value}; }

mb_value mb_text(const char *text) {
    return (mb_value){.type = MB_TEXT, .size = strlen(text), .text = text};
}

mb_value mb_list(const mb_value *items, size_t count) {
    return (mb_value){.type = MB_LIST, .size = count, .items = items};
}

bool mb_is(const mb_value *value, const char *text) {
    const mb_value other = mb_text(text);
    return mb_same_text(value, &other);
}

bool mb_same_text(const mb_value *a, const mb_value *b) {
    return a->type == MB_TEXT && b->type == MB_TEXT && a->size == b->size &&
           memcmp(a->text, b->text, a->size) == 0;
}

double mb_number(const mb_value *value) {
    if (value->type == MB_REAL) return value->real;
    if (value->type == MB_UINT) return (double)value->large;
    return value->type == MB_INT ? (double)value->integer : 0.0;
}

const mb_value *mb_find(const mb_value *map, const char *key) {
    if (map->type != MB_MAP) return NULL;
    for (size_t n = 0; n < map->size; n++)
        if (mb_is(&map->items[2 * n], key)) return &map->items[2 * n + 1];
    return NULL;
}

/* --- buffers --- */

void *mb_resize(void *old, size_t count, size_t size) {
    if (count == 0) count = 1;
    void *memory = count <= SIZE_MAX / size ? realloc(old, count * size) : NULL;
    if (memory == NULL) {
        fputs("out of memory\n", stderr);
        abort();
    }
    return memory;
}

void mb_add(mb_buffer *buffer, const void *data, size_t size) {
    if (size == 0) return;
    if (size > buffer->room - buffer->size) {
        size_t room = buffer->room < LEAST_ROOM ? LEAST_ROOM : 2 * buffer->room;
        if (room < buffer->size + size) room = buffer->size + size;
        buffer->data = mb_resize(buffer->data, room, 1);
        buffer->room = room;
    }
    memcpy(buffer->data + buffer->size, data, size);
    buffer->size += size;
}

void mb_add_byte(mb_buffer *buffer, uint8_t byte) { mb_add(buffer, &byte, 1); }

void mb_free(mb_buffer *buffer) {
    free(buffer->data);
    *buffer = (mb_buffer){0};
}

/* --- writing --- */

static void write_big(mb_buffer *out, uint8_t head, uint64_t value, int width) {
    mb_add_byte(out, head);
    for (int shift = 8 * (width - 1); shift >= 0; shift -= 8) mb_add_byte(out, (uint8_t)(value >> shift));
}

/* A length after the first of three heads, for 1, 2 and 4 bytes, that is wide enough; 0: no such head. */
static void write_head(mb_buffer *out, size_t length, const uint8_t heads[3]) {
    if (heads[0] != 0 && length <= UINT8_MAX) write_big(out, heads[0], length, 1);
    else if (length <= UINT16_MAX) write_big(out, heads[1], length, 2);
    else write_big(out, heads[2], length, 4);
}

static void write_unsigned(mb_buffer *out, uint64_t value) {
    if (value < 0x80) mb_add_byte(out, (uint8_t)value);
    else if (value <= UINT32_MAX) write_head(out, (size_t)value, (const uint8_t[]){0xcc, 0xcd, 0xce});
    else write_big(out, 0xcf, value, 8);
}

void mb_write_int(mb_buffer *out, int64_t value) {
    if (value >= 0) write_unsigned(out, (uint64_t)value);
    else if (value >= -32) mb_add_byte(out, (uint8_t)value);
    else if (value >= INT8_MIN) write_big(out, 0xd0, (uint64_t)value, 1);
    else if (value >= INT16_MIN) write_big(out, 0xd1, (uint64_t)value, 2);
    else if (value >= INT32_MIN) write_big(out, 0xd2, (uint64_t)value, 4);
    else write_big(out, 0xd3, (uint64_t)value, 8);
}

static void write_real(mb_buffer *out, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    write_big(out, 0xcb, bits, 8);
}

static void write_sized_text(mb_buffer *out, const char *text, size_t size) {
    if (size < 32) mb_add_byte(out, (uint8_t)(0xa0 | size));
    else write_head(out, size, (const uint8_t[]){0xd9, 0xda, 0xdb});
    mb_add(out, text, size);
}

void mb_write_text(mb_buffer *out, const char *text) { write_sized_text(out, text, strlen(text)); }

void mb_write_list(mb_buffer *out, size_t count) {
    if (count < 16) mb_add_byte(out, (uint8_t)(0x90 | count));
    else write_head(out, count, (const uint8_t[]){0, 0xdc, 0xdd});
}

void mb_write_map(mb_buffer *out, size_t count) {
    if (count < 16) mb_add_byte(out, (uint8_t)(0x80 | count));
    else write_head(out, count, (const uint8_t[]){0, 0xde, 0xdf});
}

static void write_extension(mb_buffer *out, const mb_value *value) {
    static const size_t fixed[] = {1, 2, 4, 8, 16};
    size_t place = 0;
    while (place < 5 && fixed[place] != value->size) place++;
    if (place < 5) mb_add_byte(out, (uint8_t)(0xd4 + place));
    else write_head(out, value->size, (const uint8_t[]){0xc7, 0xc8, 0xc9});
    mb_add_byte(out, (uint8_t)value->extension);
    mb_add(out, value->bytes, value->size);
}

void mb_write(mb_buffer *out, const mb_value *value) {
    size_t items = value->size;
    switch (value->type) {
        case MB_NIL: mb_add_byte(out, 0xc0); return;
        case MB_BOOL: mb_add_byte(out, value->boolean ? 0xc3 : 0xc2); return;
        case MB_INT: mb_write_int(out, value->integer); return;
        case MB_UINT: write_unsigned(out, value->large); return;
        case MB_REAL: write_real(out, value->real); return;
        case MB_TEXT: write_sized_text(out, value->text, value->size); return;
        case MB_EXTENSION: write_extension(out, value); return;
        case MB_BYTES:
            write_head(out, value->size, (const uint8_t[]){0xc4, 0xc5, 0xc6});
            mb_add(out, value->bytes, value->size);
            return;
        case MB_LIST: mb_write_list(out, value->size); break;
        case MB_MAP:
            mb_write_map(out, value->size);
            items = 2 * value->size;
            break;
    }
    for (size_t n = 0; n < items; n++) mb_write(out, &value->items[n]);
}

void mb_set(mb_map *map, const char *key, mb_value value) {
    mb_write_text(&map->entries, key);
    mb_write(&map->entries, &value);
    map->count++;
}

void mb_finish_map(mb_buffer *out, mb_map *map) {
    mb_write_map(out, map->count);
    mb_add(out, map->entries.data, map->entries.size);
    mb_free(&map->entries);
    map->count = 0;
}

/* --- reading --- */

/* Memory of a document: a list of blocks. */
typedef struct block {
    struct block *next;
    mb_value values[];
} block;

typedef struct reader {
    const uint8_t *at;
    const uint8_t *end;
    size_t budget; /* values that may still be made: each takes a byte at least */
    block **blocks;
} reader;

static bool read_value(reader *in, mb_value *value, int depth);

/* The next bytes; NULL, with a problem, if there are too few. */
static const uint8_t *take(reader *in, uint64_t size) {
    if (size > (uint64_t)(in->end - in->at)) {
        mb_refuse("a value is cut off");
        return NULL;
    }
    in->at += size;
    return in->at - size;
}

static bool read_big(reader *in, int width, uint64_t *value) {
    const uint8_t *bytes = take(in, (uint64_t)width);
    if (bytes == NULL) return false;
    *value = 0;
    for (int n = 0; n < width; n++) *value = *value << 8 | bytes[n];
    return true;
}

/* Length of the UTF-8 sequence at the beginning of a text; 0 if it is invalid. */
static size_t sequence(const uint8_t *text, size_t size) {
    const uint8_t first = text[0];
    if (first < 0x80) return 1;
    const size_t length = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
    if (first < 0xc2 || first > 0xf4 || length > size) return 0;
    for (size_t n = 1; n < length; n++)
        if ((text[n] & 0xc0) != 0x80) return 0;
    const bool is_overlong = (first == 0xe0 && text[1] < 0xa0) || (first == 0xf0 && text[1] < 0x90);
    const bool is_surrogate = first == 0xed && text[1] >= 0xa0;
    const bool is_beyond = first == 0xf4 && text[1] >= 0x90;
    return is_overlong || is_surrogate || is_beyond ? 0 : length;
}

static bool is_utf8(const uint8_t *text, size_t size) {
    for (size_t at = 0, length; at < size; at += length)
        if ((length = sequence(text + at, size - at)) == 0) return false;
    return true;
}

static bool read_text(reader *in, mb_value *value, uint64_t size) {
    const uint8_t *bytes = take(in, size);
    if (bytes == NULL) return false;
    if (!is_utf8(bytes, (size_t)size)) return mb_refuse("a text is not UTF-8");
    *value = (mb_value){.type = MB_TEXT, .size = (size_t)size, .text = (const char *)bytes};
    return true;
}

static bool read_bytes(reader *in, mb_value *value, uint64_t size) {
    const uint8_t *bytes = take(in, size);
    if (bytes == NULL) return false;
    *value = (mb_value){.type = MB_BYTES, .size = (size_t)size, .bytes = bytes};
    return true;
}

static bool read_extension(reader *in, mb_value *value, uint64_t size) {
    uint64_t type;
    if (!read_big(in, 1, &type) || !read_bytes(in, value, size)) return false;
    value->type = MB_EXTENSION;
    value->extension = (int8_t)(uint8_t)type;
    return true;
}

static bool read_items(reader *in, mb_value *value, mb_type type, uint64_t count, int depth) {
    const uint64_t items = type == MB_MAP ? 2 * count : count;
    if (depth >= DEEPEST) return mb_refuse("a value is nested more than %d times", DEEPEST);
    if (items > in->budget) return mb_refuse("a value is cut off");
    in->budget -= (size_t)items;
    block *memory = mb_resize(NULL, 1, sizeof(block) + (size_t)items * sizeof(mb_value));
    memory->next = *in->blocks;
    *in->blocks = memory;
    for (size_t n = 0; n < items; n++) {
        if (!read_value(in, &memory->values[n], depth + 1)) return false;
        const bool is_key = type == MB_MAP && n % 2 == 0;
        if (is_key && memory->values[n].type != MB_TEXT) return mb_refuse("a key is not text");
    }
    *value = (mb_value){.type = type, .size = (size_t)count, .items = memory->values};
    return true;
}

static bool read_real(reader *in, mb_value *value, int width) {
    uint64_t bits;
    if (!read_big(in, width, &bits)) return false;
    *value = mb_real(0.0);
    if (width == 8) memcpy(&value->real, &bits, sizeof bits);
    else {
        const uint32_t narrow = (uint32_t)bits;
        float real;
        memcpy(&real, &narrow, sizeof narrow);
        value->real = real;
    }
    return true;
}

static bool read_int(reader *in, mb_value *value, int width, bool is_signed) {
    uint64_t bits;
    if (!read_big(in, width, &bits)) return false;
    const uint64_t sign = (uint64_t)1 << (8 * width - 1);
    if (is_signed) bits = (bits ^ sign) - sign;
    const bool is_large = !is_signed && bits > INT64_MAX;
    *value = mb_int(0);
    if (is_large) *value = (mb_value){.type = MB_UINT, .large = bits};
    else memcpy(&value->integer, &bits, sizeof bits);
    return true;
}

static bool read_sized(reader *in, mb_value *value, uint8_t head, int depth) {
    static const int widths[] = {1, 2, 4};
    const bool counts_items = head >= 0xdc;
    const int first = head >= 0xde ? 0xde : head >= 0xdc ? 0xdc : head >= 0xd9 ? 0xd9 : head >= 0xc7 ? 0xc7 : 0xc4;
    uint64_t size;
    if (!read_big(in, widths[head - first + (counts_items ? 1 : 0)], &size)) return false;
    switch (first) {
        case 0xc4: return read_bytes(in, value, size);
        case 0xc7: return read_extension(in, value, size);
        case 0xd9: return read_text(in, value, size);
        case 0xdc: return read_items(in, value, MB_LIST, size, depth);
        default: return read_items(in, value, MB_MAP, size, depth);
    }
}

static bool read_value(reader *in, mb_value *value, int depth) {
    const uint8_t *taken = take(in, 1);
    if (taken == NULL) return false;
    const uint8_t head = *taken;
    *value = mb_nil();
    if (head < 0x80) *value = mb_int(head);
    else if (head >= 0xe0) *value = mb_int((int64_t)head - 0x100);
    else if (head < 0x90) return read_items(in, value, MB_MAP, head & 0x0f, depth);
    else if (head < 0xa0) return read_items(in, value, MB_LIST, head & 0x0f, depth);
    else if (head < 0xc0) return read_text(in, value, head & 0x1f);
    else if (head == 0xc1) return mb_refuse("a reserved byte");
    else if (head == 0xc2 || head == 0xc3) *value = mb_bool(head == 0xc3);
    else if (head == 0xca || head == 0xcb) return read_real(in, value, head == 0xca ? 4 : 8);
    else if (head >= 0xcc && head <= 0xcf) return read_int(in, value, 1 << (head - 0xcc), false);
    else if (head >= 0xd0 && head <= 0xd3) return read_int(in, value, 1 << (head - 0xd0), true);
    else if (head >= 0xd4 && head <= 0xd8) return read_extension(in, value, (uint64_t)1 << (head - 0xd4));
    else if (head != 0xc0) return read_sized(in, value, head, depth);
    return true;
}

bool mb_read(mb_document *document, const uint8_t *data, size_t size, size_t *used) {
    block *blocks = NULL;
    reader in = {.at = data, .end = data + size, .budget = size, .blocks = &blocks};
    *document = (mb_document){.root = {.type = MB_NIL}};
    bool is_read = read_value(&in, &document->root, 0);
    if (is_read && used == NULL && in.at != in.end) is_read = mb_refuse("a value has data after its end");
    document->blocks = blocks;
    if (used != NULL) *used = (size_t)(in.at - data);
    if (!is_read) mb_release(document);
    return is_read;
}

mb_document mb_copy(const mb_value *value) {
    mb_buffer data = {0};
    mb_document copy;
    mb_write(&data, value);
    mb_read(&copy, data.data, data.size, NULL);
    copy.own = data.data;
    return copy;
}

void mb_release(mb_document *document) {
    for (block *next, *at = document->blocks; at != NULL; at = next) {
        next = at->next;
        free(at);
    }
    free(document->own);
    *document = (mb_document){.root = {.type = MB_NIL}};
}
