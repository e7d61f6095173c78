/* The random streams of generators (PROTOCOL.md, P9.24 and P9.28). */

#ifndef MB_RANDOM_H
#define MB_RANDOM_H

#include <stddef.h>
#include <stdint.h>

/* BLAKE2b (RFC 7693) without a key; `size` is that of the result, at most 64. */
void mb_blake2b(const void *data, size_t length, uint8_t *result, size_t size);

/* Philox4x64-10. */
typedef struct mb_philox {
    uint64_t key[2];
    uint64_t words[4];
    uint64_t block;
    int used; /* words of this block */
} mb_philox;

/* The stream of (seed, who, frame). */
mb_philox mb_philox_of(int64_t seed, const char *who, int64_t frame);

uint64_t mb_philox_word(mb_philox *stream);

/* The next number, from 0 to less than 1. */
double mb_philox_number(mb_philox *stream);

#endif
