package minervabus;

import java.util.List;
import java.util.Map;
import java.util.function.Predicate;

/**
 * A reading of another member (PROTOCOL.md, section 11).
 *
 * @param topic and publisher: where it is from
 * @param items of the message: type, robot, time, ...
 */
public record Reading(String topic, String publisher, List<Object> items) {
    private static final Predicate<Object> TEXT = String.class::isInstance;
    private static final Predicate<Object> INT = Long.class::isInstance;
    private static final Predicate<Object> BYTES = byte[].class::isInstance;
    private static final Predicate<Object> REAL = item -> item instanceof Number number && !Double.isNaN(number.doubleValue());
    private static final Predicate<Object> REAL_OR_NIL = item -> item == null || REAL.test(item);
    private static final Predicate<Object> PLACE = item -> item instanceof List<?> list && list.size() == 3 && isEach(list, REAL);
    private static final Predicate<Object> SIGHTING = item ->
            item instanceof List<?> list && list.size() == 3 && TEXT.test(list.get(0)) && isEach(list.subList(1, 3), REAL);
    private static final Predicate<Object> SIGHTINGS = item -> item instanceof List<?> list && isEach(list, SIGHTING);
    private static final Predicate<Object> MOTION = item -> item instanceof List<?> list
            && isEach(list, row -> row instanceof List<?> step && step.size() == 4 && isEach(step, REAL));

    private static final Map<String, List<Predicate<Object>>> ITEMS = Map.of(
            "scan", List.of(TEXT, REAL, BYTES, REAL, REAL, REAL, PLACE),
            "sweep", List.of(TEXT, REAL, BYTES, REAL, REAL, REAL, PLACE, REAL, MOTION),
            "sightings", List.of(TEXT, REAL, SIGHTINGS),
            "image", List.of(TEXT, REAL, TEXT, INT, INT, BYTES, PLACE),
            "odometry", List.of(TEXT, REAL, REAL, REAL, REAL, REAL, REAL),
            "battery", List.of(TEXT, REAL, REAL, REAL),
            "position", List.of(TEXT, REAL, REAL, REAL, REAL_OR_NIL, REAL_OR_NIL));

    private static boolean isEach(List<?> list, Predicate<Object> check) {
        for (var item : list) if (!check.test(item)) return false;
        return true;
    }

    /** Checks that a value is a reading, and returns its items. */
    static List<Object> checked(Object plain) {
        if (!(plain instanceof List<?> reading) || reading.isEmpty() || !(reading.get(0) instanceof String type)) {
            throw new Invalid("not a reading");
        }
        var items = ITEMS.get(type);
        if (items == null) throw new Invalid("no reading is called " + type);
        if (reading.size() != items.size() + 1) throw new Invalid(type + " has " + (items.size() + 1) + " items");
        for (int n = 0; n < items.size(); n++) {
            if (!items.get(n).test(reading.get(n + 1))) throw new Invalid("item " + (n + 1) + " of " + type);
        }
        return java.util.Collections.unmodifiableList(reading);
    }
}
