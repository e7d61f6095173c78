#include "random.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

enum { BLOCK = 128, ROUNDS = 12 };

static const uint64_t INITIAL[8] = {
    0x6a09e667f3bcc908, 0xbb67ae8584caa73b, 0x3c6ef372fe94f82b, 0xa54ff53a5f1d36f1,
    0x510e527fade682d1, 0x9b05688c2b3e6c1f, 0x1f83d9abfb41bd6b, 0x5be0cd19137e2179,
};
static const uint8_t ORDERS[ROUNDS][16] = {
    {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15},
    {14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3},
    {11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4},
    {7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8},
    {9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13},
    {2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9},
    {12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11},
    {13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10},
    {6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5},
    {10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0},
    {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15},
    {14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3},
};
static const uint8_t COLUMNS_AND_DIAGONALS[8][4] = {
    {0, 4, 8, 12}, {1, 5, 9, 13}, {2, 6, 10, 14}, {3, 7, 11, 15},
    {0, 5, 10, 15}, {1, 6, 11, 12}, {2, 7, 8, 13}, {3, 4, 9, 14},
};

static uint64_t rotated(uint64_t word, int bits) { return word >> bits | word << (64 - bits); }

static uint64_t little(const uint8_t *bytes) {
    uint64_t word = 0;
    for (int n = 7; n >= 0; n--) word = word << 8 | bytes[n];
    return word;
}

static void mix(uint64_t v[16], const uint8_t at[4], uint64_t x, uint64_t y) {
    uint64_t *a = &v[at[0]], *b = &v[at[1]], *c = &v[at[2]], *d = &v[at[3]];
    *a += *b + x;
    *d = rotated(*d ^ *a, 32);
    *c += *d;
    *b = rotated(*b ^ *c, 24);
    *a += *b + y;
    *d = rotated(*d ^ *a, 16);
    *c += *d;
    *b = rotated(*b ^ *c, 63);
}

static void compress(uint64_t state[8], const uint8_t block[BLOCK], uint64_t length, int is_last) {
    uint64_t v[16], words[16];
    for (int n = 0; n < 16; n++) words[n] = little(block + 8 * n);
    memcpy(v, state, 8 * sizeof *v);
    memcpy(v + 8, INITIAL, sizeof INITIAL);
    v[12] ^= length;
    if (is_last) v[14] = ~v[14];
    for (int round = 0; round < ROUNDS; round++)
        for (int n = 0; n < 8; n++)
            mix(v, COLUMNS_AND_DIAGONALS[n], words[ORDERS[round][2 * n]], words[ORDERS[round][2 * n + 1]]);
    for (int n = 0; n < 8; n++) state[n] ^= v[n] ^ v[n + 8];
}

void mb_blake2b(const void *data, size_t length, uint8_t *result, size_t size) {
    const uint8_t *bytes = data;
    uint64_t state[8];
    memcpy(state, INITIAL, sizeof state);
    state[0] ^= 0x01010000 ^ size;
    size_t at = 0;
    for (; length - at > BLOCK; at += BLOCK) compress(state, bytes + at, at + BLOCK, 0);
    uint8_t last[BLOCK] = {0};
    if (length > at) memcpy(last, bytes + at, length - at);
    compress(state, last, length, 1);
    for (size_t n = 0; n < size; n++) result[n] = (uint8_t)(state[n / 8] >> 8 * (n % 8));
}

mb_philox mb_philox_of(int64_t seed, const char *who, int64_t frame) {
    char text[160];
    size_t length = (size_t)snprintf(text, sizeof text, "%" PRId64 "%c%s%c%" PRId64, seed, 0, who, 0, frame);
    if (length >= sizeof text) length = sizeof text - 1; /* names have 64 characters at most */
    uint8_t key[16];
    mb_blake2b(text, length, key, sizeof key);
    return (mb_philox){.key = {little(key), little(key + 8)}, .used = 4};
}

static uint64_t high(uint64_t a, uint64_t b) {
    const uint64_t a0 = a & 0xffffffff, a1 = a >> 32, b0 = b & 0xffffffff, b1 = b >> 32;
    const uint64_t low = a0 * b0, middle = a1 * b0 + (low >> 32), other = a0 * b1 + (middle & 0xffffffff);
    return a1 * b1 + (middle >> 32) + (other >> 32);
}

static void next_block(mb_philox *stream) {
    static const uint64_t m0 = 0xd2e7470ee14c6c93, m1 = 0xca5a826395121157;
    uint64_t k0 = stream->key[0], k1 = stream->key[1];
    uint64_t c0 = ++stream->block, c1 = 0, c2 = 0, c3 = 0;
    for (int round = 0; round < 10; round++) {
        const uint64_t d0 = high(m1, c2) ^ c1 ^ k0, d2 = high(m0, c0) ^ c3 ^ k1;
        c1 = m1 * c2;
        c3 = m0 * c0;
        c0 = d0;
        c2 = d2;
        k0 += 0x9e3779b97f4a7c15;
        k1 += 0xbb67ae8584caa73b;
    }
    memcpy(stream->words, (uint64_t[]){c0, c1, c2, c3}, sizeof stream->words);
    stream->used = 0;
}

uint64_t mb_philox_word(mb_philox *stream) {
    if (stream->used == 4) next_block(stream);
    return stream->words[stream->used++];
}

double mb_philox_number(mb_philox *stream) { return (double)(mb_philox_word(stream) >> 11) * 0x1p-53; }
