package minervabus;

import java.util.ArrayList;
import java.util.Arrays;
import java.util.Comparator;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import java.util.TreeMap;

/** A generator in step: it makes the events of each frame. */
public abstract class Generator extends Role {
    private static final int MAX_PENDING = 1000; // messages that wait for a tick

    /** Where readings are from, and for which frame; -1: any. */
    private record Source(long frame, String topic, String publisher) {}

    private record Answer(long frame, Map<String, List<Object>> published, List<Object> ticked) {}

    private static final Comparator<Source> BY_SOURCE = Comparator.comparing(Source::topic).thenComparing(Source::publisher);

    private final TreeMap<Long, List<Event>> orders = new TreeMap<>();
    private final Map<Source, List<Reading>> readings = new LinkedHashMap<>();
    private Map<?, ?> sources = Map.of();
    private Long asked;
    private long askedBy; // the epoch of the coordinator; its successor asks again
    private Answer last;
    private Member member;

    /** The event types that it generates. */
    protected abstract List<String> generates();

    /** Emits the events of a frame. */
    protected abstract void tick(Moment moment);

    /** The event types for which it takes people's orders. */
    protected List<String> orders() {
        return List.of();
    }

    /** The topics of readings that it needs. */
    protected List<String> topics() {
        return List.of();
    }

    /** The topics on which it publishes. */
    protected List<String> publishes() {
        return List.of();
    }

    /** What a successor needs to continue after this frame: plain values. */
    protected Map<String, ?> save() {
        return Map.of();
    }

    /** Continues with what a predecessor has saved. Whole numbers are Long. */
    protected void restore(Map<String, ?> saved) {}

    @Override
    List<String> subscriptions() {
        var keys = new ArrayList<>(List.of("tick"));
        for (var topic : topics()) keys.add("topic/" + topic + "/*");
        return keys;
    }

    @Override
    Map<String, Object> hello() {
        return Map.of(
                "generates", generates(), "when", "in step",
                "orders", orders(), "topics", topics(), "publishes", publishes());
    }

    @Override
    void welcome(Member member, boolean isAgain) {
        this.member = member;
        asked = null;
        readings.clear();
        // The predecessor's answer to this frame may already count, so it is given again.
        if (isAgain && hasAnswered(member.joined().frame())) return;
        last = null;
        var saved = member.joined().saved();
        if (saved != null) Member.own(() -> restore(texts(saved)));
    }

    @SuppressWarnings("unchecked") // keys of messages are texts
    private static Map<String, ?> texts(Map<?, ?> map) {
        return (Map<String, ?>) map;
    }

    @Override
    void receive(Member member, String message, List<?> items) {
        this.member = member;
        switch (message) {
            case "sources" -> {
                sources = (Map<?, ?>) items.get(0);
                tryToAnswer();
            }
            case "orders" -> receiveOrders((Long) items.get(0), (List<?>) items.get(1));
            case "tick" -> receiveTick((Long) items.get(0));
            case "repeat" -> repeat((String) items.get(0));
            default -> { }
        }
    }

    private void receiveOrders(long frame, List<?> plain) {
        var events = new ArrayList<Event>();
        for (var event : plain) events.add(Event.read(event, member.joined().vocabulary()));
        if (orders.size() == MAX_PENDING && !orders.containsKey(frame)) throw new Invalid("too many orders wait for a tick");
        orders.put(frame, events);
    }

    private void receiveTick(long frame) {
        if (hasAnswered(frame)) {
            give();
            return;
        }
        asked = frame;
        askedBy = member.epoch();
        tryToAnswer();
    }

    private boolean hasAnswered(long frame) {
        return last != null && last.frame() == frame;
    }

    private void repeat(String topic) {
        var published = last == null ? null : last.published().get(topic);
        if (published != null) member.publish(topic, published);
    }

    @Override
    void readings(String topic, String publisher, long frame, List<Reading> received) {
        var source = new Source(frame, topic, publisher);
        if (readings.size() == MAX_PENDING && !readings.containsKey(source)) {
            throw new Invalid("too many readings wait for a tick");
        }
        readings.put(source, received);
        tryToAnswer();
    }

    /** Whether the readings of all publishers in step are there. */
    private boolean isReady() {
        return topics().stream().allMatch(topic -> !(sources.get(topic) instanceof List<?> publishers)
                || publishers.stream().allMatch(each -> readings.containsKey(new Source(asked, topic, (String) each))));
    }

    private void tryToAnswer() {
        if (asked == null || askedBy != member.epoch() || !isReady()) return;
        long frame = asked;
        asked = null;
        var moment = new Moment(member, frame, takeOrders(frame), takeReadings(frame), publishes());
        Member.own(() -> tick(moment));
        last = answer(moment);
        give();
    }

    private Answer answer(Moment moment) {
        var saved = save();
        var published = new LinkedHashMap<String, List<Object>>();
        moment.published().forEach((topic, list) -> published.put(topic, List.of("readings", moment.frame(), list)));
        var kept = saved.isEmpty() ? null : new LinkedHashMap<>(saved);
        return new Answer(moment.frame(), published, Arrays.asList("ticked", moment.frame(), moment.events(), kept));
    }

    private List<Event> takeOrders(long frame) {
        var due = orders.headMap(frame, true);
        var events = due.values().stream().flatMap(List::stream).toList();
        due.clear();
        return events;
    }

    private List<Reading> takeReadings(long frame) {
        var due = readings.keySet().stream().filter(source -> source.frame() == frame || source.frame() == -1);
        var result = due.sorted(BY_SOURCE).flatMap(source -> readings.get(source).stream()).toList();
        readings.keySet().removeIf(source -> source.frame() <= frame);
        return result;
    }

    private void give() {
        last.published().forEach(member::publish);
        member.send(last.ticked());
    }
}
