package minervabus;

import java.util.ArrayDeque;
import java.util.ArrayList;
import java.util.List;
import java.util.Map;
import java.util.regex.Pattern;

/**
 * A node of a string; the nodes of a scope follow in reading order.
 *
 * @param symbol such as `PShell`
 * @param id of an agent, or null
 * @param values parameters or attributes by name; null for a slot
 * @param depth number of nodes around it
 */
public record Node(String symbol, String id, Map<String, Object> values, int depth) {
    private static final int DEEPEST = 100_000;
    private static final String LETTERS = "PTA";
    private static final Pattern ID = Pattern.compile("[A-Za-z0-9_][A-Za-z0-9_:-]*");

    boolean isSlot() {
        return id != null && values == null;
    }

    Node within(int more) {
        return new Node(symbol, id, values, depth + more);
    }

    /** The nodes of a string of single nodes, as it is in a message. */
    static List<Node> read(Object plain, Vocabulary vocabulary) {
        if (!(plain instanceof List<?> flat) || flat.isEmpty()) throw new Invalid("not a string");
        var nodes = new ArrayList<Node>();
        // Numbers of nodes that scopes still lack, the innermost one first: a stack, because strings may be deep.
        var missing = new ArrayDeque<Long>();
        missing.push(count(flat.get(0)));
        close(missing);
        for (var piece : flat.subList(1, flat.size())) {
            if (missing.isEmpty()) throw new Invalid("a string has data after its end");
            nodes.add(node(piece, vocabulary, missing.size() - 1));
            missing.push(missing.pop() - 1);
            missing.push(scope(piece));
            close(missing);
            if (missing.size() > DEEPEST) throw new Invalid("a string is nested too deeply");
        }
        if (!missing.isEmpty()) throw new Invalid("a string is cut off");
        return nodes;
    }

    private static void close(ArrayDeque<Long> missing) {
        while (!missing.isEmpty() && missing.peek() == 0) missing.pop();
    }

    private static long count(Object plain) {
        if (plain instanceof Long count && count >= 0) return count;
        throw new Invalid("not a count");
    }

    private static Node node(Object plain, Vocabulary vocabulary, int depth) {
        if (!(plain instanceof List<?> piece) || piece.isEmpty() || !(piece.get(0) instanceof String symbol)) {
            throw new Invalid("not a node");
        }
        int size = symbol.isEmpty() ? 0 : LETTERS.indexOf(symbol.charAt(0)) + 2;
        if (size < 2 || piece.size() != size) throw new Invalid("not a node of " + symbol);
        var fields = vocabulary.symbol(symbol);
        if (size < 4) return new Node(symbol, null, Vocabulary.read(piece.get(1), fields), depth);
        // The slot of a part of a population has the name of the part, which is no id.
        boolean isSlot = piece.get(2) == null;
        if (!(piece.get(1) instanceof String id) || !(isSlot || ID.matcher(id).matches())) throw new Invalid("not an id");
        return new Node(symbol, id, isSlot ? null : Vocabulary.read(piece.get(2), fields), depth);
    }

    /** Number of nodes directly in the scope of a node that has been read. */
    private static long scope(Object plain) {
        var piece = (List<?>) plain;
        return piece.size() == 2 ? 0 : count(piece.get(piece.size() - 1));
    }
}
