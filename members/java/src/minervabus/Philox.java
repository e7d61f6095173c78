package minervabus;

import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.nio.charset.StandardCharsets;

/** The random stream of (seed, who, frame): Philox4x64-10 (PROTOCOL.md, P9.24 and P9.28). */
final class Philox {
    private static final long M0 = 0xd2e7470ee14c6c93L;
    private static final long M1 = 0xca5a826395121157L;

    private final long[] key = new long[2];
    private final long[] words = new long[4];
    private long block;
    private int used = words.length;

    Philox(long seed, String who, long frame) {
        var text = seed + "\0" + who + "\0" + frame;
        var hash = Blake2b.hash(text.getBytes(StandardCharsets.UTF_8), 16);
        ByteBuffer.wrap(hash).order(ByteOrder.LITTLE_ENDIAN).asLongBuffer().get(key);
    }

    long word() {
        if (used == words.length) nextBlock();
        return words[used++];
    }

    /** The next number, from 0 to less than 1. */
    double number() {
        return (word() >>> 11) * 0x1p-53;
    }

    private void nextBlock() {
        block++;
        used = 0;
        long c0 = block, c1 = 0, c2 = 0, c3 = 0, k0 = key[0], k1 = key[1];
        for (int round = 0; round < 10; round++) {
            long d0 = high(M1, c2) ^ c1 ^ k0, d2 = high(M0, c0) ^ c3 ^ k1;
            c1 = M1 * c2;
            c3 = M0 * c0;
            c0 = d0;
            c2 = d2;
            k0 += 0x9e3779b97f4a7c15L;
            k1 += 0xbb67ae8584caa73bL;
        }
        System.arraycopy(new long[] {c0, c1, c2, c3}, 0, words, 0, words.length);
    }

    /** The upper half of an unsigned product of 128 bits; Math.multiplyHigh is signed. */
    private static long high(long a, long b) {
        return Math.multiplyHigh(a, b) + (a >> 63 & b) + (b >> 63 & a);
    }
}
