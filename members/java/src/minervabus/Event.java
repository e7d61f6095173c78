package minervabus;

import java.util.ArrayList;
import java.util.List;
import java.util.Map;
import java.util.TreeSet;

/**
 * An event.
 *
 * @param type its type, such as `eSun`
 * @param values its data by name: Double, Long, Boolean, String or List
 * @param condition of the agents that respond, or ""
 * @param sender the agent that has emitted it, or ""
 * @param receivers ids of agents; none: all that subscribe to the type
 */
public record Event(String type, Map<String, ?> values, String condition, String sender, List<String> receivers) {
    private static final int SHORT = 2, LONG = 5;

    /** An event for all agents that subscribe to its type. */
    public static Event of(String type, Map<String, ?> values) {
        return new Event(type, values, "", "", List.of());
    }

    /** An event without data. */
    public static Event of(String type) {
        return of(type, Map.of());
    }

    /** The same event under a condition, such as `water < 1`. */
    public Event when(String condition) {
        return new Event(type, values, condition, sender, receivers);
    }

    /** The same event for these agents only. */
    public Event to(String... receivers) {
        return new Event(type, values, condition, sender, List.of(receivers));
    }

    /** The event in a message. */
    static Event read(Object plain, Vocabulary vocabulary) {
        boolean isEvent = plain instanceof List<?> items && (items.size() == SHORT || items.size() == LONG);
        if (!isEvent || !(((List<?>) plain).get(0) instanceof String type)) throw new Invalid("not an event");
        var items = (List<?>) plain;
        var values = Vocabulary.read(items.get(1), vocabulary.event(type));
        if (items.size() == SHORT) return of(type, values);
        if (!(items.get(2) instanceof String condition) || !(items.get(3) instanceof String sender)) {
            throw new Invalid("not an event");
        }
        return new Event(type, values, condition, sender, texts(items.get(4)));
    }

    private static List<String> texts(Object plain) {
        if (!(plain instanceof List<?> list)) throw new Invalid("not an event");
        var texts = new ArrayList<String>();
        for (var item : list) {
            if (!(item instanceof String text)) throw new Invalid("receivers that are no ids");
            texts.add(text);
        }
        return texts;
    }

    /** The event as it is in a message. */
    List<Object> written(Vocabulary vocabulary) {
        var data = Vocabulary.write(values, vocabulary.event(type), type);
        if (condition.isEmpty() && sender.isEmpty() && receivers.isEmpty()) return List.of(type, data);
        return List.of(type, data, condition, sender, List.copyOf(new TreeSet<>(receivers)));
    }
}
