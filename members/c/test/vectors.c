/* Answers questions about encodings and random streams, one on each line of the standard input.
 * members/tests compares the answers with protocol/vectors. Bytes and texts are hexadecimal. */

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../src/random.h"
#include "../src/scene.h"
#include "../src/wire.h"

static mb_vocabulary vocabulary;

static void print_hex(const void *data, size_t size) {
    for (size_t n = 0; n < size; n++) printf("%02x", ((const uint8_t *)data)[n]);
}

static void print_bits(double real) {
    uint64_t bits;
    memcpy(&bits, &real, sizeof bits);
    printf("%016" PRIx64, bits);
}

/* A value as text: its type in one letter, then its content. */
static void print_value(const mb_value *value) {
    const bool is_map = value->type == MB_MAP;
    switch (value->type) {
        case MB_NIL: putchar('n'); return;
        case MB_BOOL: putchar(value->boolean ? 't' : 'f'); return;
        case MB_INT: printf("i%" PRId64, value->integer); return;
        case MB_UINT: printf("i%" PRIu64, value->large); return;
        case MB_REAL: putchar('r'), print_bits(value->real); return;
        case MB_TEXT: putchar('s'), print_hex(value->text, value->size); return;
        case MB_BYTES: putchar('b'), print_hex(value->bytes, value->size); return;
        case MB_EXTENSION: printf("x%d:", value->extension), print_hex(value->bytes, value->size); return;
        case MB_LIST:
        case MB_MAP: break;
    }
    putchar(is_map ? '{' : '[');
    for (size_t n = 0; n < (is_map ? 2 * value->size : value->size); n++) {
        if (n > 0) putchar(',');
        print_value(&value->items[n]);
    }
    putchar(is_map ? '}' : ']');
}

static void print_again(const mb_value *value) {
    mb_buffer out = {0};
    mb_write(&out, value);
    print_hex(out.data, out.size);
    mb_free(&out);
}

static void print_string(const mb_value *value) {
    mb_nodes nodes = {0};
    if (mb_read_string(&vocabulary, value, &nodes)) printf("%zu", nodes.count);
    else printf("refused");
    free(nodes.items);
}

static void print_event(const mb_value *value) {
    mb_event event;
    mb_buffer out = {0};
    if (mb_read_event(&vocabulary, value, &event) && mb_write_event(&vocabulary, &out, &event))
        print_hex(out.data, out.size);
    else printf("refused");
    mb_free(&out);
}

static void print_reading(const mb_value *value) { printf(mb_check_reading(value) ? "read" : "refused"); }

static void load(const mb_value *value) { printf(mb_load_vocabulary(&vocabulary, value) ? "read" : "refused"); }

/* Number of network messages in a batch. */
static void print_batch(const uint8_t *data, size_t size) {
    mb_batch batch;
    mb_message message;
    size_t count = 0;
    bool is_read = mb_wire_batch(data, size, &batch);
    const uint8_t *at = batch.body, *end = batch.body + batch.size;
    while (is_read && batch.type == MB_FRAME && at < end) {
        is_read = mb_wire_message(&at, end, &message);
        count++;
    }
    if (is_read) printf("%zu", count);
    else printf("refused");
}

static void print_philox(char **words) {
    mb_philox stream = mb_philox_of(strtoll(words[0], NULL, 10), words[1], strtoll(words[2], NULL, 10));
    mb_philox again = stream;
    const int count = atoi(words[3]);
    for (int n = 0; n < count; n++) printf("%016" PRIx64 " ", mb_philox_word(&stream));
    for (int n = 0; n < count; n++) print_bits(mb_philox_number(&again)), putchar(' ');
}

static size_t bytes_of(const char *hex, uint8_t *bytes) {
    unsigned byte;
    size_t size = 0;
    while (sscanf(hex + 2 * size, "%2x", &byte) == 1) bytes[size++] = (uint8_t)byte;
    return size;
}

typedef struct question {
    const char *name;
    void (*answer)(const mb_value *value);
} question;

static const question QUESTIONS[] = {
    {"data", print_value},     {"again", print_again},     {"string", print_string},
    {"event", print_event},    {"reading", print_reading}, {"vocabulary", load},
};

static void answer_about(const char *name, const uint8_t *data, size_t size) {
    mb_document document;
    for (size_t n = 0; n < sizeof QUESTIONS / sizeof *QUESTIONS; n++) {
        if (strcmp(QUESTIONS[n].name, name) != 0) continue;
        if (mb_read(&document, data, size, NULL)) QUESTIONS[n].answer(&document.root);
        else printf("refused");
        mb_release(&document);
    }
}

static void answer(char **words) {
    uint8_t *data = mb_resize(NULL, strlen(words[1]) / 2 + 1, 1);
    const size_t size = bytes_of(words[1], data);
    mb_buffer epoch = {0};
    data = mb_resize(data, size + 1, 1);
    if (strcmp(words[0], "philox") == 0) print_philox(words + 1);
    else if (strcmp(words[0], "batch") == 0) print_batch(data, size);
    else if (strcmp(words[0], "name") == 0) {
        data[size] = 0;
        printf(mb_is_name((const char *)data) ? "true" : "false");
    } else if (strcmp(words[0], "epoch") == 0) {
        mb_write_int(&epoch, strtoll(words[1], NULL, 10));
        print_hex(epoch.data, epoch.size);
    } else answer_about(words[0], data, size);
    mb_free(&epoch);
    free(data);
    putchar('\n');
}

/* The next line without its end; NULL at the end of the input. */
static char *next_line(void) {
    mb_buffer line = {0};
    for (int letter; (letter = getchar()) != EOF && letter != '\n';) mb_add_byte(&line, (uint8_t)letter);
    mb_add_byte(&line, 0);
    if (line.size > 1) return (char *)line.data;
    mb_free(&line);
    return NULL;
}

int main(void) {
    for (char *line; (line = next_line()) != NULL; free(line)) {
        char *words[8] = {"", "", "", "", "", "", "", ""};
        int count = 0;
        for (char *word = strtok(line, " "); word != NULL && count < 7; word = strtok(NULL, " ")) words[count++] = word;
        answer(words);
    }
    mb_release(&vocabulary.document);
    return 0;
}
