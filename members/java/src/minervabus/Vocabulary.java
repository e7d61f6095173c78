package minervabus;

import java.util.HashMap;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;

/** The vocabulary of a world: the fields of its symbols and event types, and checks of their values. */
final class Vocabulary {
    /** A field of a symbol or event type. */
    record Field(String name, String type) {}

    private static final String LIST = "list of ";

    private final Map<String, List<Field>> symbols = new HashMap<>();
    private final Map<String, List<Field>> events = new HashMap<>();

    Vocabulary(Map<?, ?> plain) {
        for (var part : List.of("primitives", "transformations", "kinds")) read(plain.get(part), symbols);
        read(plain.get("events"), events);
    }

    private static void read(Object part, Map<String, List<Field>> names) {
        if (!(part instanceof List<?> rows)) throw new Invalid("a vocabulary");
        for (var row : rows) {
            var items = items(row);
            names.put(text(items.get(0)), items(items.get(1)).stream().map(Vocabulary::field).toList());
        }
    }

    private static Field field(Object plain) {
        var items = items(plain);
        return new Field(text(items.get(0)), text(items.get(1)));
    }

    private static List<?> items(Object plain) {
        if (plain instanceof List<?> items && (items.isEmpty() || items.size() >= 2)) return items;
        if (plain instanceof List<?> items && items.get(0) instanceof List<?>) return items;
        throw new Invalid("a vocabulary");
    }

    private static String text(Object plain) {
        if (plain instanceof String text) return text;
        throw new Invalid("a vocabulary");
    }

    List<Field> symbol(String name) {
        return known(symbols, name);
    }

    List<Field> event(String name) {
        return known(events, name);
    }

    private static List<Field> known(Map<String, List<Field>> names, String name) {
        var fields = names.get(name);
        if (fields == null) throw new Invalid("the world's vocabulary has no " + name);
        return fields;
    }

    // --- values ---

    /** Values from a message, by name. */
    static Map<String, Object> read(Object plain, List<Field> fields) {
        if (!(plain instanceof List<?> values) || values.size() != fields.size()) throw new Invalid("wrong number of values");
        var result = new LinkedHashMap<String, Object>();
        for (int n = 0; n < fields.size(); n++) {
            var field = fields.get(n);
            result.put(field.name(), checked(values.get(n), field.type()));
        }
        return result;
    }

    /** Values by name, as they are in a message of `what`. */
    static List<Object> write(Map<String, ?> values, List<Field> fields, String what) {
        var known = fields.stream().map(Field::name).toList();
        for (var name : values.keySet()) {
            if (!known.contains(name)) throw new Invalid(what + " has no " + name + "; it has " + known);
        }
        return fields.stream().map(field -> written(values.get(field.name()), field, what)).toList();
    }

    private static Object written(Object value, Field field, String what) {
        if (value == null) throw new Invalid(what + " needs a value for " + field.name() + " (" + field.type() + ")");
        try {
            return checked(value, field.type());
        } catch (Invalid problem) {
            throw new Invalid(field.name() + " of " + what + ": " + problem.getMessage());
        }
    }

    /** A value of a type; any whole number is an `int`, any number a `real`. */
    private static Object checked(Object value, String type) {
        if (type.startsWith(LIST) && value instanceof List<?> list) {
            return list.stream().map(item -> checked(item, type.substring(LIST.length()))).toList();
        }
        boolean isWhole = value instanceof Long || value instanceof Integer || value instanceof Short;
        var result = switch (type.split(" ")[0]) {
            case "real" -> value instanceof Number number && Double.isFinite(number.doubleValue()) ? number.doubleValue() : null;
            case "int" -> isWhole ? ((Number) value).longValue() : null;
            case "bool" -> value instanceof Boolean ? value : null;
            case "text" -> value instanceof String ? value : null;
            case "cells", "matrix" -> isExtension(value, 1) ? value : null;
            case "string" -> isExtension(value, 2) ? value : null;
            default -> null;
        };
        if (result == null) throw new Invalid(value + " is not of type " + type);
        return result;
    }

    private static boolean isExtension(Object value, int type) {
        return value instanceof MessagePack.Extension extension && extension.type() == type;
    }
}
