package minervabus;

import java.io.ByteArrayOutputStream;
import java.nio.ByteBuffer;
import java.nio.charset.StandardCharsets;
import java.util.ArrayList;
import java.util.Arrays;
import java.util.List;

/** Zenoh's messages as bytes, as far as a client in the members' role needs them (docs/reference/protocol/zenoh-wire.md). */
final class Wire {
    static final int LONGEST_BATCH = 0xffff;
    static final int ID_BYTES = 16;

    private static final int VERSION = 9;
    private static final int CLIENT = 0x02;
    private static final int RESOLUTIONS = 0x0a; // sequence numbers and request ids of 32 bits
    private static final long SEQUENCE_MASK = 0x0fffffff;
    private static final int BLOCK_AT_DATA_PRIORITY = 0x0d;
    private static final int FRAME_ROOM = 6; // a header and a sequence number of at most five bytes

    private static final int INIT = 0x01, OPEN = 0x02, CLOSE = 0x03, KEEP_ALIVE = 0x04, FRAME = 0x05, FRAGMENT = 0x06;
    private static final int LAST_TRANSPORT = 0x07; // JOIN, between routers
    private static final int INTEREST = 0x19, PUSH = 0x1d, DECLARE = 0x1e, ADMINISTRATION = 0x1f;
    private static final int NAMED = 0x20, RELIABLE = 0x20, MORE = 0x40, EXTENSIONS = 0x80, TYPE = 0x1f;

    private Wire() {}

    // --- writing ---

    private static final class Writer {
        private final ByteArrayOutputStream out = new ByteArrayOutputStream();

        Writer bytes(int... bytes) {
            for (int value : bytes) out.write(value);
            return this;
        }

        Writer data(byte[] data) {
            out.writeBytes(data);
            return this;
        }

        Writer number(long number) {
            for (; number >>> 7 != 0; number >>>= 7) out.write((int) (number & 0x7f | 0x80));
            out.write((int) number);
            return this;
        }

        Writer slice(byte[] data) {
            return number(data.length).data(data);
        }

        Writer key(String key) {
            return bytes(0).slice(key.getBytes(StandardCharsets.UTF_8));
        }

        byte[] done() {
            return out.toByteArray();
        }
    }

    static byte[] init(byte[] id) {
        var head = new Writer().bytes(INIT | 0x40, VERSION, (ID_BYTES - 1) << 4 | CLIENT).data(id);
        return head.bytes(RESOLUTIONS, LONGEST_BATCH & 0xff, LONGEST_BATCH >> 8).done();
    }

    static byte[] open(int leaseSeconds, long sequence, byte[] cookie) {
        return new Writer().bytes(OPEN | 0x40).number(leaseSeconds).number(sequence).slice(cookie).done();
    }

    static byte[] keepAlive() {
        return new byte[] {KEEP_ALIVE};
    }

    static byte[] close() {
        return new byte[] {CLOSE | 0x20, 0};
    }

    static byte[] put(String key, byte[] payload) {
        var head = new Writer().bytes(PUSH | NAMED | EXTENSIONS).key(key);
        return head.bytes(0x21, BLOCK_AT_DATA_PRIORITY, 0x01).slice(payload).done();
    }

    static byte[] subscriber(long number, String key) {
        return new Writer().bytes(DECLARE, 0x02 | NAMED).number(number).key(key).done();
    }

    static byte[] token(long number, String key) {
        return new Writer().bytes(DECLARE, 0x06 | NAMED).number(number).key(key).done();
    }

    static byte[] noToken(long number) {
        return new Writer().bytes(DECLARE, 0x07).number(number).done();
    }

    /** INTEREST in the tokens of a key: those that exist, and with `isLasting` those to come. */
    static byte[] interest(long number, String key, boolean isLasting) {
        var head = new Writer().bytes(INTEREST | 0x20 | (isLasting ? 0x40 : 0)).number(number);
        return head.bytes(0x39).key(key).done(); // mappings and tokens of a key with a text
    }

    /** The batches that carry a network message from a sequence number on: one FRAME, or FRAGMENTs. */
    static List<byte[]> batches(byte[] message, long sequence, int batchSize) {
        int room = batchSize - FRAME_ROOM;
        int type = message.length <= room ? FRAME : FRAGMENT;
        var batches = new ArrayList<byte[]>();
        for (int at = 0; at < message.length; at += room) {
            int size = Math.min(room, message.length - at);
            int more = at + size < message.length ? MORE : 0;
            var head = new Writer().bytes(type | RELIABLE | more).number(after(sequence, batches.size()));
            head.out.write(message, at, size);
            batches.add(head.done());
        }
        return batches;
    }

    /** The sequence number so many places after one. */
    static long after(long sequence, int count) {
        return sequence + count & SEQUENCE_MASK;
    }

    // --- reading ---

    enum Transport { INIT, OPEN, CLOSE, KEEP_ALIVE, FRAME, FRAGMENT }

    /** A transport message; `body` is that of a FRAME or FRAGMENT, or the bytes after a KEEP_ALIVE. */
    record Batch(Transport type, byte[] body, boolean hasMore, int batchSize, byte[] cookie, long leaseMillis) {
        static Batch of(Transport type, byte[] body, boolean hasMore) {
            return new Batch(type, body, hasMore, 0, null, 0);
        }
    }

    /** What a network message is about; OTHER is of no concern to a member. */
    enum Network { PUT, KEY, NO_KEY, TOKEN, NO_TOKEN, FINAL, OTHER, BATCH }

    /** A key expression: the number of a declared one, 0 for none, and what follows it. */
    record Key(long mapping, String suffix) {}

    /** A network message. `interest`: the number of the INTEREST that it answers, or -1; `key` may be null. */
    record Message(Network type, long interest, long number, Key key, byte[] payload) {
        static final Message OTHER = new Message(Network.OTHER, -1, 0, null, null);
    }

    private static final class Reader {
        private final ByteBuffer in;

        Reader(byte[] data) {
            in = ByteBuffer.wrap(data);
        }

        int octet() {
            return take(1)[0] & 0xff;
        }

        byte[] take(long size) {
            if (size < 0 || size > in.remaining()) throw new Invalid("a message of Zenoh is cut off");
            var bytes = new byte[(int) size];
            in.get(bytes);
            return bytes;
        }

        long number() {
            long number = 0;
            for (int shift = 0; shift < 64; shift += 7) {
                int octet = octet();
                number |= (long) (octet & 0x7f) << shift;
                if (octet < 0x80) return number;
            }
            throw new Invalid("a number of Zenoh is too long");
        }

        byte[] slice() {
            return take(number());
        }

        byte[] rest() {
            return take(in.remaining());
        }

        String text(byte[] bytes) {
            return new String(bytes, StandardCharsets.UTF_8);
        }

        Key key(int header) {
            long mapping = number();
            return new Key(mapping, (header & NAMED) != 0 ? text(slice()) : "");
        }

        /** Skips extensions, if the header announces any; the body of the one that names what is undeclared, or null. */
        byte[] extensions(int header) {
            byte[] key = null;
            boolean hasMore = (header & EXTENSIONS) != 0;
            while (hasMore) {
                int head = octet();
                switch (head & 0x60) {
                    case 0x20 -> number();
                    case 0x40 -> {
                        var body = slice();
                        if ((head & 0x0f) == 0x0f) key = body;
                    }
                    case 0x60 -> throw new Invalid("an extension of Zenoh has an unknown form");
                    default -> { }
                }
                hasMore = (head & 0x80) != 0;
            }
            return key;
        }
    }

    /** The transport message in a batch. */
    static Batch batch(byte[] data) {
        var in = new Reader(data);
        int header = in.octet();
        switch (header & TYPE) {
            case INIT:
                return init(in, header);
            case OPEN:
                long lease = in.number() * ((header & 0x40) != 0 ? 1000 : 1);
                return new Batch(Transport.OPEN, null, false, 0, null, lease);
            case CLOSE:
                return Batch.of(Transport.CLOSE, null, false);
            case KEEP_ALIVE:
                in.extensions(header);
                return Batch.of(Transport.KEEP_ALIVE, in.rest(), false);
            case FRAME, FRAGMENT:
                in.number();
                in.extensions(header);
                var type = (header & TYPE) == FRAME ? Transport.FRAME : Transport.FRAGMENT;
                return Batch.of(type, in.rest(), (header & MORE) != 0);
            default:
                throw new Invalid("Zenoh's transport message " + (header & TYPE) + " is unknown");
        }
    }

    private static Batch init(Reader in, int header) {
        in.octet();
        in.take((in.octet() >> 4) + 1);
        int batchSize = LONGEST_BATCH;
        if ((header & 0x40) != 0) {
            in.octet();
            batchSize = in.octet() | in.octet() << 8;
        }
        return new Batch(Transport.INIT, null, false, batchSize, in.slice(), 0);
    }

    /**
     * The network messages in the body of a FRAME. Further transport messages may share its batch, such as the
     * CLOSE of a router that ends: they come last, as the payload of one of type BATCH.
     */
    static List<Message> messages(byte[] body) {
        var in = new Reader(body);
        var messages = new ArrayList<Message>();
        while (in.in.hasRemaining()) {
            int start = in.in.position();
            int header = in.octet();
            if ((header & TYPE) <= LAST_TRANSPORT) {
                messages.add(new Message(Network.BATCH, -1, 0, null, Arrays.copyOfRange(body, start, body.length)));
                break;
            }
            messages.add(switch (header & TYPE) {
                case PUSH -> push(in, header);
                case DECLARE -> declaration(in, header);
                case INTEREST -> interest(in, header);
                case ADMINISTRATION -> administration(in, header);
                // Queries: a member declares no queryable, so none follows. The rest cannot be read.
                default -> throw new Invalid("Zenoh's network message " + (header & TYPE) + " is unknown");
            });
        }
        return messages;
    }

    private static Message push(Reader in, int header) {
        var key = in.key(header);
        in.extensions(header);
        int body = in.octet();
        boolean isPut = (body & TYPE) == 0x01;
        if ((body & 0x20) != 0) {
            in.number();
            in.slice();
        }
        if (isPut && (body & 0x40) != 0 && (in.number() & 1) != 0) in.slice();
        in.extensions(body);
        return isPut ? new Message(Network.PUT, -1, 0, key, in.slice()) : Message.OTHER;
    }

    private static final Network[] DECLARATIONS = {
        Network.KEY, Network.NO_KEY, Network.OTHER, Network.OTHER,
        Network.OTHER, Network.OTHER, Network.TOKEN, Network.NO_TOKEN,
    };

    private static Message declaration(Reader in, int header) {
        long interest = (header & 0x20) != 0 ? in.number() : -1;
        in.extensions(header);
        int head = in.octet();
        int id = head & TYPE;
        if (id == 0x1a) {
            in.extensions(head);
            return new Message(Network.FINAL, interest, 0, null, null);
        }
        if (id >= DECLARATIONS.length) throw new Invalid("Zenoh's declaration " + id + " is unknown");
        long number = in.number();
        var key = id % 2 == 0 ? in.key(head) : null;
        var undeclared = in.extensions(head);
        return new Message(DECLARATIONS[id], interest, number, undeclared != null ? undeclaredKey(undeclared) : key, null);
    }

    /** An undeclaration may have the key of what it undeclares: flags, mapping, and the text to the end. */
    private static Key undeclaredKey(byte[] body) {
        var in = new Reader(body);
        int flags = in.octet();
        long mapping = in.number();
        return new Key(mapping, (flags & 0x01) != 0 ? in.text(in.rest()) : "");
    }

    private static Message interest(Reader in, int header) {
        in.number();
        if ((header & 0x60) != 0) {
            int options = in.octet();
            if ((options & 0x10) != 0) in.key(options);
        }
        in.extensions(header);
        return Message.OTHER;
    }

    private static Message administration(Reader in, int header) {
        in.number();
        in.extensions(header);
        int form = header & 0x60;
        if (form == 0x20) in.number();
        else if (form == 0x40) in.slice();
        return Message.OTHER;
    }
}
