package minervabus;

import java.util.ArrayList;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import java.util.Set;
import java.util.function.Predicate;

/** The protocol of a member as a state machine, without sockets and clocks (PROTOCOL.md, section 6). */
final class Member {
    static final int VERSION = 7;
    static final int MESSAGE_BYTES = 64 * 1024 * 1024;

    private static final int GREETING = 10, SUCCESSOR = 5, FLUSHING = 1; // seconds
    /** Messages that begin a member's obedience to a coordinator. */
    private static final Set<String> LEADING = Set.of("greet", "refused", "stop");

    /** What a member does outside. Keys are those after `minerva/WORLD/`. */
    interface Outside {
        void put(String key, byte[] data);

        boolean isReleased();

        /** Undeclares the member's token. */
        void release();

        /** Declares it again, once the name is free. */
        void rejoin();

        /** Ends the member with a code in so many seconds; 0: not at all. */
        void await(int seconds, int code);

        void log(String line);

        void end(int code);
    }

    /** What a coordinator has said in its welcome. */
    record Welcome(Vocabulary vocabulary, long seed, double dt, long frame, Map<?, ?> saved) {}

    /** Exit code after an error that the same input would cause again. */
    private static final int RAISED = 70;

    private final String name;
    private final Role role;
    private final Outside outside;
    private long epoch = -1;
    private Welcome joined;
    /** The frame that it was last asked for; -1 before the first. */
    private long frame = -1;
    private boolean obeys;
    private boolean hasCoordinator;
    private boolean isStopping;

    Member(String name, Role role, Outside outside) {
        this.name = name;
        this.role = role;
        this.outside = outside;
    }

    String name() {
        return name;
    }

    /** The epoch of the coordinator that it obeys. */
    long epoch() {
        return epoch;
    }

    /** Its welcome; only after it has joined. */
    Welcome joined() {
        return joined;
    }

    List<String> subscriptions() {
        var keys = new ArrayList<>(List.of("all", "to/" + name));
        keys.addAll(role.subscriptions());
        return keys;
    }

    /** Its token is declared: for the first time, or again. */
    void begin() {
        outside.await(GREETING, 1);
    }

    void send(Object... message) {
        outside.put("from/" + name, MessagePack.encode(epoch, List.of(message)));
    }

    void send(List<Object> message) {
        outside.put("from/" + name, MessagePack.encode(epoch, message));
    }

    void publish(String topic, List<Object> message) {
        outside.put("topic/" + topic + "/" + name, MessagePack.encode(message));
    }

    void leave() {
        if (joined != null) send("leaving");
        outside.end(0);
    }

    private Map<String, Object> hello() {
        var hello = new LinkedHashMap<String, Object>();
        hello.put("version", VERSION);
        hello.put("when", "");
        for (var key : List.of("kinds", "generates", "orders", "draws", "topics", "publishes")) hello.put(key, List.of());
        hello.put("coupled", false);
        hello.put("about", Map.of("service", role.service(), "pid", ProcessHandle.current().pid()));
        hello.put("plain", true);
        hello.putAll(role.hello());
        return hello;
    }

    // --- receiving ---

    private static final Predicate<Object> TEXT = String.class::isInstance;
    private static final Predicate<Object> FRAME = item -> item instanceof Long frame && frame >= 0;
    private static final Predicate<Object> INT = Long.class::isInstance;
    private static final Predicate<Object> NUMBER = item -> item instanceof Number number && Double.isFinite(number.doubleValue());
    private static final Predicate<Object> MAP = Map.class::isInstance;
    private static final Predicate<Object> LIST = List.class::isInstance;
    private static final Predicate<Object> TEXTS = item -> item instanceof List<?> list && list.stream().allMatch(TEXT);
    private static final Predicate<Object> SOURCES = item -> item instanceof Map<?, ?> map && map.values().stream().allMatch(TEXTS);
    private static final Predicate<Object> MAP_OR_NIL = item -> item == null || MAP.test(item);
    private static final Predicate<Object> LIST_OR_NIL = item -> item == null || LIST.test(item);

    private static final Map<String, List<Predicate<Object>>> ITEMS = Map.ofEntries(
            Map.entry("greet", List.of()),
            Map.entry("welcome", List.of(TEXT, MAP, INT, NUMBER, FRAME, TEXT, MAP_OR_NIL)),
            Map.entry("refused", List.of(TEXT)),
            Map.entry("sources", List.of(SOURCES)),
            Map.entry("tick", List.of(FRAME)),
            Map.entry("fragments", List.of(MAP, TEXTS)),
            Map.entry("evolve", List.of(FRAME, TEXTS, LIST, LIST, FRAME, TEXTS)),
            Map.entry("view", List.of(TEXT, FRAME, FRAME, MAP, LIST_OR_NIL, TEXTS)),
            Map.entry("orders", List.of(FRAME, LIST)),
            Map.entry("repeat", List.of(TEXT)),
            Map.entry("stop", List.of(TEXT)));

    /** A message on a key. One that cannot be read is dropped; an error of the program's own code ends the member. */
    void receive(String key, byte[] data) {
        try {
            if (data.length > MESSAGE_BYTES) throw new Invalid("it is too large");
            if (key.startsWith("topic/")) receiveReadings(key.split("/"), data);
            else receiveFromCoordinator(data);
        } catch (Invalid problem) {
            outside.log("dropped a message on " + key + ": " + problem.getMessage());
        } catch (RuntimeException error) {
            fail(error);
        }
    }

    /** Calls the program's own code, whose invalid values are its failure, not that of a message. */
    static void own(Runnable code) {
        try {
            code.run();
        } catch (Invalid problem) {
            throw new IllegalStateException(problem.getMessage(), problem);
        }
    }

    private void fail(RuntimeException error) {
        var problem = error.getMessage() == null ? error.toString() : error.getMessage();
        var trace = new java.io.StringWriter();
        error.printStackTrace(new java.io.PrintWriter(trace));
        problem += ownPlace(error);
        // The stack is in the log of the world.
        send("failed", frame, problem, trace.toString());
        outside.log(problem);
        outside.end(RAISED);
    }

    /** The innermost line of the program's own code, as a second line of an error. */
    private static String ownPlace(Throwable error) {
        for (var each : error.getStackTrace()) {
            boolean isOwn = !each.getClassName().startsWith("minervabus.") && !each.getClassName().startsWith("java.");
            if (isOwn) return "\n    at " + each;
        }
        return "";
    }

    private void receiveReadings(String[] key, byte[] data) {
        if (joined == null || key.length != 3) return;
        var message = MessagePack.decode(data);
        boolean isMessage = message instanceof List<?> items && items.size() == 3 && "readings".equals(items.get(0))
                && items.get(1) instanceof Long frame && frame >= -1 && items.get(2) instanceof List<?>;
        if (!isMessage) throw new Invalid("not readings");
        var items = (List<?>) message;
        var readings = ((List<?>) items.get(2)).stream().map(item -> new Reading(key[1], key[2], Reading.checked(item)));
        role.readings(key[1], key[2], (Long) items.get(1), readings.toList());
    }

    private void receiveFromCoordinator(byte[] data) {
        var values = MessagePack.decodeAll(data, 2);
        boolean isMessage = values.get(0) instanceof Long && values.get(1) instanceof List<?> list && !list.isEmpty();
        if (!isMessage || !(((List<?>) values.get(1)).get(0) instanceof String message)) throw new Invalid("not a message");
        var items = ((List<?>) values.get(1)).subList(1, ((List<?>) values.get(1)).size());
        var checks = ITEMS.get(message);
        if (checks == null) throw new Invalid("no message is called " + message);
        boolean isRight = items.size() == checks.size();
        for (int n = 0; isRight && n < items.size(); n++) isRight = checks.get(n).test(items.get(n));
        if (!isRight) throw new Invalid("the items of " + message);
        if (follows((Long) values.get(0), message)) act(message, items);
    }

    private boolean follows(long theirs, String message) {
        if (theirs > epoch && LEADING.contains(message)) {
            epoch = theirs;
            obeys = true;
        }
        return obeys && theirs == epoch;
    }

    private void act(String message, List<?> items) {
        switch (message) {
            case "greet" -> send("hello", hello());
            case "welcome" -> receiveWelcome(items);
            case "refused" -> {
                outside.log("refused: " + items.get(0));
                outside.end(2);
            }
            case "stop" -> stop();
            default -> {
                if (message.equals("tick") || message.equals("evolve")) frame = (Long) items.get(0);
                if (message.equals("view")) frame = (Long) items.get(1);
                if (joined != null || message.equals("sources")) role.receive(this, message, items);
            }
        }
    }

    private void receiveWelcome(List<?> items) {
        long seed = (Long) items.get(2);
        double dt = ((Number) items.get(3)).doubleValue();
        boolean isAgain = joined != null;
        if (isAgain && (seed != joined.seed() || dt != joined.dt())) {
            outside.log("the world has another seed or step than before");
            outside.end(1);
            return;
        }
        var vocabulary = new Vocabulary((Map<?, ?>) items.get(1));
        joined = new Welcome(vocabulary, seed, dt, (Long) items.get(4), (Map<?, ?>) items.get(6));
        outside.await(0, 0);
        role.welcome(this, isAgain);
    }

    /** The report must arrive before the session ends, so it stays for a moment. */
    private void stop() {
        own(() -> send("report", role.report()));
        isStopping = true;
        outside.await(FLUSHING, 0);
    }

    // --- the coordinator ---

    /** The coordinator's token has appeared or vanished. */
    void onCoordinator(boolean isThere) {
        if (isStopping) {
            if (!isThere) outside.end(0);
            return;
        }
        if (!isThere && hasCoordinator) lose();
        else if (isThere && !hasCoordinator && outside.isReleased()) outside.rejoin();
        hasCoordinator = isThere;
    }

    private void lose() {
        outside.release();
        // The same coordinator may come back with the same epoch, but must greet first.
        epoch--;
        obeys = false;
        outside.await(SUCCESSOR, 1);
    }
}
