package minervabus;

import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.util.Arrays;

/** BLAKE2b (RFC 7693) without a key, which the class library lacks. */
final class Blake2b {
    private static final int BLOCK = 128;
    private static final long[] INITIAL = {
        0x6a09e667f3bcc908L, 0xbb67ae8584caa73bL, 0x3c6ef372fe94f82bL, 0xa54ff53a5f1d36f1L,
        0x510e527fade682d1L, 0x9b05688c2b3e6c1fL, 0x1f83d9abfb41bd6bL, 0x5be0cd19137e2179L,
    };
    private static final String[] ORDERS = {
        "0123456789abcdef", "ea489fd61c02b753", "b8c052fdae367194", "7931dcbe265a40f8", "905724afe1bc683d",
        "2c6a0b834d75fe19", "c51fed4a0763928b", "db7ec13950f4862a", "6fe9b308c2d714a5", "a2847615fb9e3cd0",
        "0123456789abcdef", "ea489fd61c02b753",
    };
    private static final int[][] COLUMNS_AND_DIAGONALS = {
        {0, 4, 8, 12}, {1, 5, 9, 13}, {2, 6, 10, 14}, {3, 7, 11, 15},
        {0, 5, 10, 15}, {1, 6, 11, 12}, {2, 7, 8, 13}, {3, 4, 9, 14},
    };

    private Blake2b() {}

    /** The hash of bytes, of `size` bytes. */
    static byte[] hash(byte[] data, int size) {
        var state = INITIAL.clone();
        state[0] ^= 0x01010000 ^ size;
        int at = 0;
        for (; data.length - at > BLOCK; at += BLOCK) compress(state, data, at, at + BLOCK, false);
        compress(state, Arrays.copyOfRange(data, at, at + BLOCK), 0, data.length, true);
        var result = ByteBuffer.allocate(64).order(ByteOrder.LITTLE_ENDIAN);
        for (long word : state) result.putLong(word);
        return Arrays.copyOf(result.array(), size);
    }

    private static void compress(long[] state, byte[] data, int at, int length, boolean isLast) {
        var words = new long[16];
        ByteBuffer.wrap(data, at, BLOCK).order(ByteOrder.LITTLE_ENDIAN).asLongBuffer().get(words);
        var v = Arrays.copyOf(state, 16);
        System.arraycopy(INITIAL, 0, v, 8, 8);
        v[12] ^= length;
        if (isLast) v[14] = ~v[14];
        for (var order : ORDERS) {
            for (int n = 0; n < 8; n++) {
                long x = words[Character.digit(order.charAt(2 * n), 16)];
                long y = words[Character.digit(order.charAt(2 * n + 1), 16)];
                mix(v, COLUMNS_AND_DIAGONALS[n], x, y);
            }
        }
        for (int n = 0; n < 8; n++) state[n] ^= v[n] ^ v[n + 8];
    }

    private static void mix(long[] v, int[] at, long x, long y) {
        int a = at[0], b = at[1], c = at[2], d = at[3];
        v[a] += v[b] + x;
        v[d] = Long.rotateRight(v[d] ^ v[a], 32);
        v[c] += v[d];
        v[b] = Long.rotateRight(v[b] ^ v[c], 24);
        v[a] += v[b] + y;
        v[d] = Long.rotateRight(v[d] ^ v[a], 16);
        v[c] += v[d];
        v[b] = Long.rotateRight(v[b] ^ v[c], 63);
    }
}
