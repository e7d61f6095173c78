package minervabus;

import java.util.List;
import java.util.Map;

/** What a member does in a world: a {@link Generator} or a {@link Device}. */
public abstract class Role {
    Role() {}

    /** What it is, for people. */
    protected String service() {
        return getClass().getSimpleName();
    }

    /** Figures for the summary: numbers, texts or booleans. */
    protected Map<String, ?> report() {
        return Map.of();
    }

    /** Keys of its subscriptions, besides those of every member. */
    abstract List<String> subscriptions();

    abstract Map<String, Object> hello();

    abstract void welcome(Member member, boolean isAgain);

    /** A message after the welcome; throws Invalid if it cannot be read. */
    abstract void receive(Member member, String message, List<?> items);

    void readings(String topic, String publisher, long frame, List<Reading> readings) {}
}
