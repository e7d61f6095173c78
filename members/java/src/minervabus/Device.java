package minervabus;

import java.util.ArrayList;
import java.util.Arrays;
import java.util.HashMap;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;

/** A device: it draws the views of visual events. */
public abstract class Device extends Role {
    /** What is known of the views of one type. */
    private static final class Known {
        private final Map<String, List<Node>> parts = new HashMap<>();
        private List<Node> skeleton; // null: no key view yet
        private long sequence = -1;

        boolean misses(long number, List<Node> newSkeleton) {
            return newSkeleton == null && (skeleton == null || number > sequence + 1);
        }

        /** Takes a view; whether it was not an old one. */
        boolean accept(long number, Map<String, List<Node>> newParts, List<Node> newSkeleton) {
            if (newSkeleton == null ? number != sequence + 1 : number < sequence) return false;
            sequence = number;
            if (newSkeleton != null) {
                skeleton = newSkeleton;
                parts.clear();
            }
            parts.putAll(newParts);
            return true;
        }

        /** The skeleton with each slot replaced by the part of its id. */
        List<Node> nodes() {
            var nodes = new ArrayList<Node>();
            for (var node : skeleton) {
                if (!node.isSlot()) nodes.add(node);
                else for (var inner : parts.getOrDefault(node.id(), List.of())) nodes.add(inner.within(node.depth()));
            }
            return nodes;
        }
    }

    private final Map<String, Known> views = new HashMap<>();

    /** The visual event types that it draws. */
    protected abstract List<String> draws();

    /** Draws a view. */
    protected abstract void draw(View view);

    /** When it requests its views itself: "each 10 frames", or "at 25 Hz"; empty: it does not. */
    protected String when() {
        return "";
    }

    /** Whether it draws every frame before the next one begins. */
    protected boolean isCoupled() {
        return false;
    }

    @Override
    List<String> subscriptions() {
        return isCoupled() ? List.of("tick") : draws().stream().map(type -> "view/" + type).toList();
    }

    @Override
    Map<String, Object> hello() {
        return Map.of("draws", draws(), "when", when(), "coupled", isCoupled());
    }

    /** Another coordinator may have counted the views, so the next key view is taken whatever its sequence. */
    @Override
    void welcome(Member member, boolean isAgain) {
        for (var type : draws()) views.computeIfAbsent(type, name -> new Known()).sequence = -1;
    }

    @Override
    void receive(Member member, String message, List<?> items) {
        if (message.equals("tick")) member.send(Arrays.asList("ticked", items.get(0), List.of(), null));
        else if (message.equals("view")) receiveView(member, items);
    }

    private void receiveView(Member member, List<?> items) {
        var type = (String) items.get(0);
        var known = views.get(type);
        if (known == null) return;
        var vocabulary = member.joined().vocabulary();
        var parts = new LinkedHashMap<String, List<Node>>();
        ((Map<?, ?>) items.get(3)).forEach((id, part) -> parts.put((String) id, Node.read(part, vocabulary)));
        var skeleton = items.get(4) == null ? null : Node.read(items.get(4), vocabulary);
        long sequence = (Long) items.get(2);
        if (known.misses(sequence, skeleton)) member.send("resync", type);
        else if (known.accept(sequence, parts, skeleton)) {
            var halted = ((List<?>) items.get(5)).stream().map(String.class::cast).toList();
            var view = new View(type, (Long) items.get(1), known.nodes(), halted);
            Member.own(() -> draw(view));
        }
    }
}
