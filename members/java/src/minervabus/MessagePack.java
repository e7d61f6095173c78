package minervabus;

import java.io.ByteArrayOutputStream;
import java.math.BigInteger;
import java.nio.ByteBuffer;
import java.nio.charset.CharacterCodingException;
import java.nio.charset.StandardCharsets;
import java.util.ArrayList;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;

/**
 * MessagePack of plain values: null, Boolean, Long (BigInteger above 2^63 - 1), Double, String, byte[], List, Map with
 * String keys, and Extension. When values are written, any whole number type stands for an integer.
 */
final class MessagePack {
    /** An extension: its type and its bytes. */
    record Extension(int type, byte[] data) {}

    private static final int DEEPEST = 100;
    private static final BigInteger TOO_LARGE = BigInteger.ONE.shiftLeft(64);

    private MessagePack() {}

    /** The shortest encoding of values, one after another. */
    static byte[] encode(Object... values) {
        var writer = new Writer();
        for (var value : values) writer.value(value);
        return writer.out.toByteArray();
    }

    /** The value in these bytes. */
    static Object decode(byte[] data) {
        return decodeAll(data, 1).get(0);
    }

    /** The values in these bytes, of which there must be so many. */
    static List<Object> decodeAll(byte[] data, int count) {
        var reader = new Reader(data);
        var values = new ArrayList<>(count);
        for (int n = 0; n < count; n++) values.add(reader.value(0));
        if (reader.in.hasRemaining()) throw new Invalid("a value has data after its end");
        return values;
    }

    private static final class Writer {
        final ByteArrayOutputStream out = new ByteArrayOutputStream();

        void big(int head, long value, int width) {
            out.write(head);
            for (int shift = 8 * (width - 1); shift >= 0; shift -= 8) out.write((int) (value >>> shift));
        }

        /** A length after the first of these heads, for 1, 2 and 4 bytes, that is wide enough; 0: no such head. */
        void head(long length, int one, int two, int four) {
            if (one != 0 && length < 0x100) big(one, length, 1);
            else if (length < 0x10000) big(two, length, 2);
            else big(four, length, 4);
        }

        void integer(long value) {
            if (value >= -32 && value < 0x80) out.write((int) value);
            else if (value >= 1L << 32) big(0xcf, value, 8);
            else if (value >= 0) head(value, 0xcc, 0xcd, 0xce);
            else if (value >= Byte.MIN_VALUE) big(0xd0, value, 1);
            else if (value >= Short.MIN_VALUE) big(0xd1, value, 2);
            else if (value >= Integer.MIN_VALUE) big(0xd2, value, 4);
            else big(0xd3, value, 8);
        }

        void integer(BigInteger value) {
            if (value.bitLength() < 64) integer(value.longValue());
            else if (value.signum() > 0 && value.compareTo(TOO_LARGE) < 0) big(0xcf, value.longValue(), 8);
            else throw new Invalid(value + " has more than 64 bits");
        }

        void text(String text) {
            var bytes = text.getBytes(StandardCharsets.UTF_8);
            if (bytes.length < 32) out.write(0xa0 | bytes.length);
            else head(bytes.length, 0xd9, 0xda, 0xdb);
            out.writeBytes(bytes);
        }

        void list(List<?> list) {
            if (list.size() < 16) out.write(0x90 | list.size());
            else head(list.size(), 0, 0xdc, 0xdd);
            for (var item : list) value(item);
        }

        void map(Map<?, ?> map) {
            if (map.size() < 16) out.write(0x80 | map.size());
            else head(map.size(), 0, 0xde, 0xdf);
            map.forEach((key, item) -> {
                text((String) key);
                value(item);
            });
        }

        void extension(Extension extension) {
            int length = extension.data().length;
            if (Integer.bitCount(length) == 1 && length <= 16) out.write(0xd4 + Integer.numberOfTrailingZeros(length));
            else head(length, 0xc7, 0xc8, 0xc9);
            out.write(extension.type());
            out.writeBytes(extension.data());
        }

        void value(Object value) {
            if (value == null) out.write(0xc0);
            else if (value instanceof Boolean flag) out.write(flag ? 0xc3 : 0xc2);
            else if (value instanceof Double || value instanceof Float) {
                big(0xcb, Double.doubleToRawLongBits(((Number) value).doubleValue()), 8);
            } else if (value instanceof BigInteger large) integer(large);
            else if (value instanceof Number number) integer(number.longValue());
            else if (value instanceof String text) text(text);
            else if (value instanceof List<?> list) list(list);
            else if (value instanceof Map<?, ?> map) map(map);
            else if (value instanceof Extension extension) extension(extension);
            else if (value instanceof byte[] bytes) {
                head(bytes.length, 0xc4, 0xc5, 0xc6);
                out.writeBytes(bytes);
            } else throw new Invalid("a value of type " + value.getClass().getSimpleName() + " cannot be sent");
        }
    }

    private static final class Reader {
        final ByteBuffer in;

        Reader(byte[] data) {
            in = ByteBuffer.wrap(data);
        }

        /** Checks that so many bytes are there; each item of a list or map takes one at least. */
        int needed(long count) {
            if (count > in.remaining()) throw new Invalid("a value is cut off");
            return (int) count;
        }

        long unsigned(int width) {
            needed(width);
            return switch (width) {
                case 1 -> in.get() & 0xffL;
                case 2 -> in.getShort() & 0xffffL;
                case 4 -> in.getInt() & 0xffffffffL;
                default -> in.getLong();
            };
        }

        long signed(int width) {
            int unused = 64 - 8 * width;
            return unsigned(width) << unused >> unused;
        }

        byte[] bytes(long length) {
            var bytes = new byte[needed(length)];
            in.get(bytes);
            return bytes;
        }

        String text(long length) {
            var bytes = ByteBuffer.wrap(bytes(length));
            try {
                return StandardCharsets.UTF_8.newDecoder().decode(bytes).toString();
            } catch (CharacterCodingException error) {
                throw new Invalid("a text is not UTF-8");
            }
        }

        Extension extension(long length) {
            int type = (byte) unsigned(1);
            return new Extension(type, bytes(length));
        }

        List<Object> list(long count, int depth) {
            check(depth);
            int size = needed(count);
            var list = new ArrayList<>(Math.min(size, 64));
            for (int n = 0; n < size; n++) list.add(value(depth + 1));
            return list;
        }

        Map<String, Object> map(long count, int depth) {
            check(depth);
            int size = needed(2 * count) / 2;
            var map = new LinkedHashMap<String, Object>();
            for (int n = 0; n < size; n++) {
                if (!(value(depth + 1) instanceof String key)) throw new Invalid("a key is not text");
                map.put(key, value(depth + 1));
            }
            return map;
        }

        void check(int depth) {
            if (depth >= DEEPEST) throw new Invalid("a value is nested more than " + DEEPEST + " times");
        }

        Object unsignedLong() {
            long bits = unsigned(8);
            if (bits >= 0) return bits;
            return new BigInteger(Long.toUnsignedString(bits));
        }

        Object value(int depth) {
            int head = (int) unsigned(1);
            if (head < 0x80) return (long) head;
            if (head < 0x90) return map(head & 0x0f, depth);
            if (head < 0xa0) return list(head & 0x0f, depth);
            if (head < 0xc0) return text(head & 0x1f);
            if (head >= 0xe0) return (long) (byte) head;
            return switch (head) {
                case 0xc0 -> null;
                case 0xc2 -> false;
                case 0xc3 -> true;
                case 0xc4, 0xc5, 0xc6 -> bytes(unsigned(1 << (head - 0xc4)));
                case 0xc7, 0xc8, 0xc9 -> extension(unsigned(1 << (head - 0xc7)));
                case 0xca -> (double) Float.intBitsToFloat((int) unsigned(4));
                case 0xcb -> Double.longBitsToDouble(unsigned(8));
                case 0xcc, 0xcd, 0xce -> unsigned(1 << (head - 0xcc));
                case 0xcf -> unsignedLong();
                case 0xd0, 0xd1, 0xd2, 0xd3 -> signed(1 << (head - 0xd0));
                case 0xd4, 0xd5, 0xd6, 0xd7, 0xd8 -> extension(1L << (head - 0xd4));
                case 0xd9, 0xda, 0xdb -> text(unsigned(1 << (head - 0xd9)));
                case 0xdc, 0xdd -> list(unsigned(2 << (head - 0xdc)), depth);
                case 0xde, 0xdf -> map(unsigned(2 << (head - 0xde)), depth);
                default -> throw new Invalid("a reserved byte");
            };
        }
    }
}
