package minervabus;

import java.io.IOException;
import java.util.Map;
import java.util.concurrent.ArrayBlockingQueue;
import java.util.concurrent.BlockingQueue;
import java.util.concurrent.CountDownLatch;
import java.util.concurrent.TimeUnit;
import java.util.regex.Pattern;

/** Runs a member over a Zenoh session until its world ends. */
public final class Minerva {
    private static final Pattern NAME = Pattern.compile("[A-Za-z0-9_][A-Za-z0-9_.~-]{0,63}");

    private Minerva() {}

    /**
     * Takes part in a world until it ends; returns the exit code for the program. World, endpoint and name are in
     * MINERVA_WORLD, MINERVA_CONNECT and MINERVA_NAME, as the launcher sets them.
     */
    public static int run(Role role) {
        try {
            var environment = System.getenv();
            var world = setting(environment, "MINERVA_WORLD");
            var name = setting(environment, "MINERVA_NAME");
            var endpoint = setting(environment, "MINERVA_CONNECT");
            for (var text : new String[] {world, name}) {
                if (!isName(text)) throw new Invalid(text + " is not a name of 1 to 64 letters, digits and _ . ~ -");
            }
            return new Process(role, world, name).run(endpoint);
        } catch (Invalid problem) {
            System.err.println(problem.getMessage());
            return 1;
        }
    }

    private static String setting(Map<String, String> environment, String variable) {
        var value = environment.getOrDefault(variable, "");
        if (value.isEmpty()) throw new Invalid(variable + " is not set; start this program by a world file, or set it");
        return value;
    }

    /** Whether a text can be the name of a world, member or topic. */
    static boolean isName(String text) {
        return NAME.matcher(text).matches();
    }

    private static final class Process implements Session.Listener, Member.Outside {
        private static final int TAKEN = 2000, TAKEN_AGAIN = 4000, PAUSE = 50, STEP = 500; // milliseconds
        private static final int MAX_TASKS = 1000;

        /** How far it is with the token of its name. */
        private enum Naming { RELEASED, ASKING, PAUSING, NAMED }

        private final BlockingQueue<Runnable> tasks = new ArrayBlockingQueue<>(MAX_TASKS);
        private final CountDownLatch ended = new CountDownLatch(1);
        private final String name;
        private final String prefix;
        private final Member member;
        private Session session;
        private Naming naming = Naming.RELEASED;
        private boolean isDeclared;
        private long token;
        private long nameUntil;
        private long askAt;
        private long waitUntil = Long.MAX_VALUE;
        private int waitCode;
        private volatile Integer code;

        Process(Role role, String world, String name) {
            this.name = name;
            this.prefix = "minerva/" + world + "/";
            this.member = new Member(name, role, this);
        }

        int run(String endpoint) {
            try (var opened = new Session(endpoint, tasks, this)) {
                session = opened;
                Runtime.getRuntime().addShutdownHook(new Thread(this::interrupt));
                takeName(TAKEN);
                while (code == null) step();
                release();
            } catch (IOException error) {
                log(error.getMessage() + ": no world at " + endpoint);
                code = 1;
            } catch (InterruptedException error) {
                Thread.currentThread().interrupt();
                code = 1;
            }
            ended.countDown();
            return code;
        }

        /** Runs the next task, and whatever is due. */
        private void step() throws InterruptedException {
            long now = Session.now();
            long next = Math.min(waitUntil, naming == Naming.PAUSING ? askAt : Long.MAX_VALUE);
            var task = tasks.poll(Math.max(0, Math.min(STEP, next - now)), TimeUnit.MILLISECONDS);
            if (task != null) task.run();
            if (code != null) return;
            session.check();
            if (Session.now() >= waitUntil) {
                if (waitCode != 0) log("no coordinator");
                end(waitCode);
            } else if (naming == Naming.PAUSING && Session.now() >= askAt) {
                askForName();
            }
        }

        /** SIGINT or SIGTERM: leaves the world. Runs in a thread of its own while the virtual machine ends. */
        private void interrupt() {
            if (ended.getCount() == 0) return;
            try {
                tasks.offer(member::leave, 1, TimeUnit.SECONDS);
                ended.await(1, TimeUnit.SECONDS);
            } catch (InterruptedException error) {
                Thread.currentThread().interrupt();
            }
            Runtime.getRuntime().halt(code == null ? 1 : code);
        }

        // --- the name ---

        private void takeName(int milliseconds) {
            nameUntil = Session.now() + milliseconds;
            askForName();
        }

        private void askForName() {
            naming = Naming.ASKING;
            askAt = Session.now() + PAUSE;
            session.query(prefix + "alive/" + name);
        }

        @Override
        public void onTokens(int count) {
            if (naming != Naming.ASKING) return;
            naming = Naming.PAUSING;
            if (count == 0) declare();
            else if (Session.now() > nameUntil) {
                log(count < 0 ? "the router does not return" : "another member has this name");
                end(1);
            }
        }

        /** Subscriptions and the watch of the coordinator come first, the token last (P6.3 to P6.5). */
        private void declare() {
            if (!isDeclared) {
                for (var key : member.subscriptions()) session.subscribe(prefix + key);
                session.watch(prefix + "alive/coordinator");
            }
            isDeclared = true;
            naming = Naming.NAMED;
            token = session.declareToken(prefix + "alive/" + name);
            member.begin();
        }

        // --- what the session reports ---

        @Override
        public void onSample(String key, byte[] payload) {
            if (code == null && key.startsWith(prefix)) member.receive(key.substring(prefix.length()), payload);
        }

        @Override
        public void onToken(String key, boolean isAlive) {
            if (code == null && key.equals(prefix + "alive/coordinator")) member.onCoordinator(isAlive);
        }

        @Override
        public void onProblem(String problem) {
            log("dropped a message of the bus: " + problem);
        }

        // --- what the member does outside ---

        @Override
        public void put(String key, byte[] data) {
            session.put(prefix + key, data);
        }

        @Override
        public boolean isReleased() {
            return naming != Naming.NAMED;
        }

        @Override
        public void release() {
            if (naming == Naming.NAMED) session.undeclareToken(token);
            naming = Naming.RELEASED;
        }

        @Override
        public void rejoin() {
            await(0, 0);
            if (naming == Naming.RELEASED) takeName(TAKEN_AGAIN);
        }

        @Override
        public void await(int seconds, int code) {
            waitUntil = seconds == 0 ? Long.MAX_VALUE : Session.now() + 1000L * seconds;
            waitCode = code;
        }

        @Override
        public void log(String line) {
            System.err.println(name + ": " + line);
        }

        @Override
        public void end(int code) {
            if (this.code == null) this.code = code;
        }
    }
}
