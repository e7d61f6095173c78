import java.util.HashMap;
import java.util.List;
import java.util.Map;

import minervabus.Device;
import minervabus.Event;
import minervabus.Generator;
import minervabus.Minerva;
import minervabus.Moment;
import minervabus.Role;
import minervabus.View;

/** The member of the conformance suite, in the role of MINERVA_ROLE (docs/howto/other-languages.md). */
public final class Conformance {
    private Conformance() {}

    private static Event add(double amount) {
        return Event.of("eAdd", Map.of("amount", amount));
    }

    private static final class Counter extends Generator {
        private long count;

        @Override
        protected List<String> generates() {
            return List.of("eAdd");
        }

        @Override
        protected List<String> orders() {
            return List.of("eAdd");
        }

        @Override
        protected List<String> topics() {
            return List.of("sight");
        }

        @Override
        protected List<String> publishes() {
            return List.of("echo");
        }

        @Override
        protected void tick(Moment moment) {
            moment.publish("echo", "battery", "r1", (double) moment.frame(), 1.0, (double) count);
            moment.emit(add(count + 0.5));
            moment.orders().forEach(moment::emit);
            for (var reading : moment.readings()) {
                if (!reading.items().get(0).equals("sightings")) continue;
                for (var sighting : (List<?>) reading.items().get(3)) {
                    moment.emit(add(((Number) ((List<?>) sighting).get(1)).doubleValue()));
                }
            }
            count++;
        }

        @Override
        protected Map<String, ?> save() {
            return Map.of("count", count);
        }

        @Override
        protected void restore(Map<String, ?> saved) {
            count = (Long) saved.get("count");
        }

        @Override
        protected Map<String, ?> report() {
            return Map.of("ticks", count);
        }
    }

    private static final class Bars extends Device {
        private final boolean isCoupled;
        private final Map<String, Object> drawn = new HashMap<>();
        private long views;

        Bars(boolean isCoupled) {
            this.isCoupled = isCoupled;
        }

        @Override
        protected List<String> draws() {
            return List.of("eShow");
        }

        @Override
        protected String when() {
            return "each frame";
        }

        @Override
        protected boolean isCoupled() {
            return isCoupled;
        }

        @Override
        protected void draw(View view) {
            views++;
            drawn.put("bars", view.nodes().size());
            drawn.put("length", view.nodes().stream().mapToDouble(node -> (Double) node.values().get("length")).sum());
            drawn.put("frame", view.frame());
        }

        @Override
        protected Map<String, ?> report() {
            if (isCoupled) drawn.put("views", views);
            return drawn;
        }
    }

    private static Role role(String name) {
        return switch (name) {
            case "generator" -> new Counter();
            case "observer" -> new Bars(false);
            case "coupled" -> new Bars(true);
            default -> throw new IllegalArgumentException("MINERVA_ROLE must be generator, observer or coupled");
        };
    }

    public static void main(String[] arguments) {
        System.exit(Minerva.run(role(System.getenv().getOrDefault("MINERVA_ROLE", "generator"))));
    }
}
