package minervabus;

import java.io.ByteArrayOutputStream;
import java.io.Closeable;
import java.io.DataInputStream;
import java.io.IOException;
import java.io.OutputStream;
import java.net.InetSocketAddress;
import java.net.Socket;
import java.security.SecureRandom;
import java.util.HashMap;
import java.util.LinkedHashMap;
import java.util.Map;
import java.util.concurrent.BlockingQueue;
import java.util.concurrent.TimeUnit;

/**
 * A Zenoh session in client mode over TCP: publish, subscribe and liveliness.
 *
 * <p>A thread reads from the link and puts tasks into the owner's queue; another one keeps the link alive. Everything
 * else happens in the owner's thread, which runs the tasks and calls {@link #check}.
 */
final class Session implements Closeable {
    /** What a session reports, in the owner's thread. */
    interface Listener {
        void onSample(String key, byte[] payload);

        void onToken(String key, boolean isAlive);

        /** The answer to {@link #query}: the number of tokens; -1 if the link was lost. */
        void onTokens(int count);

        void onProblem(String problem);
    }

    private static final byte[] NOTHING = {};
    private static final int LEASE_SECONDS = 3;
    private static final int OPENING = 5000; // milliseconds, as all times
    private static final int FIRST_RETRY = 50;
    private static final int LONGEST_RETRY = 500;
    private static final int LARGEST = Member.MESSAGE_BYTES + 0x10000; // bytes of a fragmented message
    private static final int MAX_MAPPINGS = 0x10000;
    private static final int MAX_TOKENS = 1024;

    private final String host;
    private final int port;
    private final BlockingQueue<Runnable> tasks;
    private final Listener listener;
    private final byte[] id = new byte[Wire.ID_BYTES];
    private final Map<Long, byte[]> declared = new LinkedHashMap<>();
    private final Map<Long, String> mappings = new HashMap<>();
    private final Map<Long, String> tokens = new LinkedHashMap<>();
    private final ByteArrayOutputStream fragments = new ByteArrayOutputStream();
    private Link link; // null: lost
    private long number; // of the last declaration
    private long sequence;
    private long query = -1;
    private int queryCount;
    private long retryAt;
    private long retry = FIRST_RETRY;

    /** Opens a session at `tcp/HOST:PORT`. Throws an IOException if no router answers there. */
    Session(String endpoint, BlockingQueue<Runnable> tasks, Listener listener) throws IOException {
        int colon = endpoint.lastIndexOf(':');
        if (!endpoint.startsWith("tcp/") || colon < 5) throw new IOException("expected tcp/HOST:PORT");
        this.host = endpoint.substring(4, colon).replaceAll("[\\[\\]]", "");
        this.port = portOf(endpoint.substring(colon + 1));
        this.tasks = tasks;
        this.listener = listener;
        new SecureRandom().nextBytes(id);
        connect();
    }

    private static int portOf(String text) throws IOException {
        if (!text.matches("[0-9]{1,5}") || Integer.parseInt(text) > 0xffff) throw new IOException("expected tcp/HOST:PORT");
        return Integer.parseInt(text);
    }

    /** Milliseconds of a clock that never goes back. */
    static long now() {
        return System.nanoTime() / 1_000_000;
    }

    // --- the link ---

    /** A TCP connection with a router, whose reader and keeper end with it. */
    private final class Link implements Closeable {
        private final Socket socket = new Socket();
        private final DataInputStream in;
        private final OutputStream out;
        private final int batchSize;
        private final long lease;
        private volatile long receivedAt = now();

        Link() throws IOException {
            try {
                socket.connect(new InetSocketAddress(host, port), OPENING);
                socket.setTcpNoDelay(true);
                socket.setSoTimeout(OPENING);
                in = new DataInputStream(new java.io.BufferedInputStream(socket.getInputStream(), 0x10000));
                out = socket.getOutputStream();
                send(Wire.init(id));
                var init = expect(Wire.Transport.INIT);
                batchSize = Math.max(64, init.batchSize());
                send(Wire.open(LEASE_SECONDS, sequence, init.cookie()));
                lease = Math.max(100, expect(Wire.Transport.OPEN).leaseMillis());
                socket.setSoTimeout(0);
            } catch (IOException | Invalid error) {
                socket.close();
                throw new IOException(error.getMessage(), error);
            }
        }

        void start() {
            daemon("zenoh reader", this::read);
            daemon("zenoh keeper", this::keepAlive);
        }

        private void daemon(String name, Runnable body) {
            var thread = new Thread(body, name);
            thread.setDaemon(true);
            thread.start();
        }

        private Wire.Batch expect(Wire.Transport type) throws IOException {
            var batch = Wire.batch(nextBatch());
            if (batch.type() != type) throw new IOException("the router refused the session");
            return batch;
        }

        private byte[] nextBatch() throws IOException {
            int low = in.readUnsignedByte();
            var batch = new byte[low | in.readUnsignedByte() << 8];
            in.readFully(batch);
            receivedAt = now();
            return batch;
        }

        /** Sends a batch after its length. */
        synchronized void send(byte[] batch) throws IOException {
            var data = new byte[batch.length + 2];
            data[0] = (byte) batch.length;
            data[1] = (byte) (batch.length >> 8);
            System.arraycopy(batch, 0, data, 2, batch.length);
            out.write(data);
        }

        private void read() {
            try {
                while (true) {
                    var batch = nextBatch();
                    tasks.put(() -> receive(this, batch));
                }
            } catch (IOException error) {
                post(() -> lose(this));
            } catch (InterruptedException error) {
                Thread.currentThread().interrupt();
            }
        }

        private void post(Runnable task) {
            try {
                tasks.put(task);
            } catch (InterruptedException error) {
                Thread.currentThread().interrupt();
            }
        }

        private void keepAlive() {
            try {
                while (!socket.isClosed()) {
                    TimeUnit.MILLISECONDS.sleep(1000 * LEASE_SECONDS / 4);
                    send(Wire.keepAlive());
                }
            } catch (IOException error) {
                close(); // the reader notices
            } catch (InterruptedException error) {
                Thread.currentThread().interrupt();
            }
        }

        boolean isSilent() {
            return now() - receivedAt > lease;
        }

        @Override
        public void close() {
            try {
                socket.close();
            } catch (IOException error) {
                // Nothing more can be sent or received either way.
            }
        }
    }

    private void connect() throws IOException {
        link = new Link();
        retry = FIRST_RETRY;
        for (var message : declared.values()) send(message);
        if (link != null) link.start();
    }

    private void lose(Link lost) {
        if (lost == null || link != lost) return;
        link = null;
        lost.close();
        mappings.clear();
        fragments.reset();
        retryAt = now() + retry;
        boolean wasAsked = query >= 0;
        query = -1;
        var gone = tokens.values().toArray(new String[0]);
        tokens.clear();
        for (var key : gone) listener.onToken(key, false);
        if (wasAsked) listener.onTokens(-1);
    }

    /** Opens a lost link again, with all declarations, and notices a silent one. To be called every half second. */
    void check() {
        if (link != null && link.isSilent()) lose(link);
        if (link != null || now() < retryAt) return;
        try {
            connect();
        } catch (IOException error) {
            retry = Math.min(LONGEST_RETRY, retry * 3 / 2);
            retryAt = now() + retry;
        }
    }

    private void send(byte[] message) {
        if (link == null) return;
        var used = link;
        try {
            var batches = Wire.batches(message, sequence, used.batchSize);
            sequence = Wire.after(sequence, batches.size());
            for (var batch : batches) used.send(batch);
        } catch (IOException error) {
            lose(used);
        }
    }

    // --- what the router sends ---

    private void receive(Link from, byte[] data) {
        if (link != from) return;
        try {
            for (var rest = data; rest.length > 0 && link == from; ) {
                var batch = Wire.batch(rest);
                rest = switch (batch.type()) {
                    case FRAME -> receiveMessages(batch.body());
                    case KEEP_ALIVE -> batch.body();
                    default -> NOTHING;
                };
                if (batch.type() == Wire.Transport.CLOSE) lose(from);
                if (batch.type() == Wire.Transport.FRAGMENT) receiveFragment(batch);
            }
        } catch (Invalid problem) {
            listener.onProblem(problem.getMessage());
        }
    }

    private void receiveFragment(Wire.Batch batch) {
        // One byte more than the limit shows that a message is too large.
        int room = LARGEST + 1 - fragments.size();
        fragments.write(batch.body(), 0, Math.min(room, batch.body().length));
        if (batch.hasMore()) return;
        var whole = fragments.toByteArray();
        fragments.reset();
        if (whole.length > LARGEST) throw new Invalid("a message is too large");
        receiveMessages(whole);
    }

    /** Returns the transport messages that follow the network messages of a FRAME. */
    private byte[] receiveMessages(byte[] body) {
        for (var message : Wire.messages(body)) {
            switch (message.type()) {
                case PUT -> listener.onSample(named(message.key()), message.payload());
                case KEY -> declareKey(message.number(), named(message.key()));
                case NO_KEY -> mappings.remove(message.number());
                case TOKEN -> receiveToken(message);
                case NO_TOKEN -> receiveNoToken(message);
                case FINAL -> receiveFinal(message.interest());
                case BATCH -> {
                    return message.payload();
                }
                case OTHER -> { }
            }
        }
        return NOTHING;
    }

    private String named(Wire.Key key) {
        if (key.mapping() == 0) return key.suffix();
        var stem = mappings.get(key.mapping());
        if (stem == null) throw new Invalid("a key that was not declared");
        return stem + key.suffix();
    }

    private void declareKey(long mapping, String key) {
        if (mappings.size() == MAX_MAPPINGS) throw new Invalid("too many mappings");
        mappings.put(mapping, key);
    }

    private void receiveToken(Wire.Message message) {
        if (query >= 0 && message.interest() == query) {
            queryCount++;
            return;
        }
        if (tokens.size() == MAX_TOKENS) throw new Invalid("too many tokens");
        var key = named(message.key());
        tokens.put(message.number(), key);
        listener.onToken(key, true);
    }

    private void receiveNoToken(Wire.Message message) {
        var known = tokens.remove(message.number());
        if (known == null && message.key() != null) known = named(message.key());
        if (known != null) listener.onToken(known, false);
    }

    private void receiveFinal(long interest) {
        if (query < 0 || interest != query) return;
        query = -1;
        listener.onTokens(queryCount);
    }

    // --- what a member does ---

    void put(String key, byte[] payload) {
        send(Wire.put(key, payload));
    }

    private void declare(byte[] message) {
        declared.put(number, message);
        send(message);
    }

    void subscribe(String key) {
        declare(Wire.subscriber(++number, key));
    }

    /** Watches the tokens of a key, those that exist included. */
    void watch(String key) {
        declare(Wire.interest(++number, key, true));
    }

    /** Declares a token; returns its number. */
    long declareToken(String key) {
        declare(Wire.token(++number, key));
        return number;
    }

    void undeclareToken(long token) {
        declared.remove(token);
        send(Wire.noToken(token));
    }

    /** Asks for the tokens of a key that exist now. */
    void query(String key) {
        if (link == null) {
            listener.onTokens(-1);
            return;
        }
        query = ++number;
        queryCount = 0;
        send(Wire.interest(query, key, false));
    }

    @Override
    public void close() {
        if (link == null) return;
        var last = link;
        link = null;
        try {
            last.send(Wire.close());
        } catch (IOException error) {
            // The router has gone already.
        }
        last.close();
    }
}
