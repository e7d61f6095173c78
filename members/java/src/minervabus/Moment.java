package minervabus;

import java.util.ArrayList;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;

/** A frame that asks a generator for its events. */
public final class Moment {
    private final Member member;
    private final long frame;
    private final List<Event> orders;
    private final List<Reading> readings;
    private final List<Object> events = new ArrayList<>();
    private final Map<String, List<Object>> published = new LinkedHashMap<>();
    private Philox stream;

    Moment(Member member, long frame, List<Event> orders, List<Reading> readings, List<String> topics) {
        this.member = member;
        this.frame = frame;
        this.orders = orders;
        this.readings = readings;
        for (var topic : topics) published.put(topic, new ArrayList<>());
    }

    /** The frame's number, from 0. */
    public long frame() {
        return frame;
    }

    /** Seconds of a frame. */
    public double dt() {
        return member.joined().dt();
    }

    /** Events of people, of the types that the generator takes orders for. */
    public List<Event> orders() {
        return orders;
    }

    /** Readings of the generator's topics. */
    public List<Reading> readings() {
        return readings;
    }

    /** The next number, from 0 to less than 1, of the stream of (seed, name, frame). */
    public double random() {
        if (stream == null) stream = new Philox(member.joined().seed(), member.name(), frame);
        return stream.number();
    }

    /** Adds an event. One that the vocabulary does not allow ends the member. */
    public void emit(Event event) {
        events.add(event.written(member.joined().vocabulary()));
    }

    /** Publishes a reading, such as `"battery", "r1", 0.5, 1.0, 12.0`, on one of the generator's topics. */
    public void publish(String topic, Object... reading) {
        var readings = published.get(topic);
        if (readings == null) throw new Invalid(topic + " is not among the topics that it publishes");
        readings.add(Reading.checked(List.of(reading)));
    }

    List<Object> events() {
        return events;
    }

    Map<String, List<Object>> published() {
        return published;
    }
}
