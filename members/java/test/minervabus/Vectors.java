package minervabus;

import java.io.BufferedReader;
import java.io.IOException;
import java.io.InputStreamReader;
import java.io.PrintStream;
import java.nio.charset.StandardCharsets;
import java.util.HexFormat;
import java.util.List;
import java.util.Map;
import java.util.stream.Collectors;

/**
 * Answers questions about encodings and random streams, one on each line of the standard input. members/tests compares
 * the answers with protocol/vectors. Bytes and texts are hexadecimal.
 */
public final class Vectors {
    private static final HexFormat HEX = HexFormat.of();
    private static Vocabulary vocabulary;

    private Vectors() {}

    /** A value as text: its type in one letter, then its content. */
    private static String shown(Object value) {
        if (value == null) return "n";
        if (value instanceof Boolean flag) return flag ? "t" : "f";
        if (value instanceof Double real) return "r" + bits(real);
        if (value instanceof Number number) return "i" + number;
        if (value instanceof String text) return "s" + HEX.formatHex(text.getBytes(StandardCharsets.UTF_8));
        if (value instanceof byte[] bytes) return "b" + HEX.formatHex(bytes);
        if (value instanceof MessagePack.Extension extension) return "x" + extension.type() + ":" + HEX.formatHex(extension.data());
        if (value instanceof List<?> list) return list.stream().map(Vectors::shown).collect(Collectors.joining(",", "[", "]"));
        return ((Map<?, ?>) value).entrySet().stream()
                .map(entry -> shown(entry.getKey()) + "," + shown(entry.getValue()))
                .collect(Collectors.joining(",", "{", "}"));
    }

    private static String bits(double real) {
        return HEX.toHexDigits(Double.doubleToRawLongBits(real));
    }

    private static String philox(String[] words) {
        long seed = Long.parseLong(words[1]), frame = Long.parseLong(words[3]);
        var stream = new Philox(seed, words[2], frame);
        var again = new Philox(seed, words[2], frame);
        var answer = new StringBuilder();
        int count = Integer.parseInt(words[4]);
        for (int n = 0; n < count; n++) answer.append(HEX.toHexDigits(stream.word())).append(' ');
        for (int n = 0; n < count; n++) answer.append(bits(again.number())).append(' ');
        return answer.toString();
    }

    private static String batch(byte[] data) {
        var batch = Wire.batch(data);
        return String.valueOf(batch.type() == Wire.Transport.FRAME ? Wire.messages(batch.body()).size() : 0);
    }

    private static String load(Object map) {
        vocabulary = new Vocabulary((Map<?, ?>) map);
        return "read";
    }

    private static String about(String question, byte[] data) {
        var value = MessagePack.decode(data);
        return switch (question) {
            case "data" -> shown(value);
            case "again" -> HEX.formatHex(MessagePack.encode(value));
            case "string" -> String.valueOf(Node.read(value, vocabulary).size());
            case "event" -> HEX.formatHex(MessagePack.encode(Event.read(value, vocabulary).written(vocabulary)));
            case "reading" -> Reading.checked(value).isEmpty() ? "empty" : "read";
            case "vocabulary" -> load(value);
            default -> throw new IllegalArgumentException(question);
        };
    }

    private static String answer(String[] words) {
        try {
            return switch (words[0]) {
                case "philox" -> philox(words);
                case "epoch" -> HEX.formatHex(MessagePack.encode(Long.parseLong(words[1])));
                case "batch" -> batch(HEX.parseHex(words[1]));
                case "name" -> {
                    var bytes = words.length > 1 ? HEX.parseHex(words[1]) : new byte[0];
                    yield String.valueOf(Minerva.isName(new String(bytes, StandardCharsets.UTF_8)));
                }
                default -> about(words[0], HEX.parseHex(words[1]));
            };
        } catch (Invalid problem) {
            return "refused";
        }
    }

    public static void main(String[] arguments) throws IOException {
        var in = new BufferedReader(new InputStreamReader(System.in, StandardCharsets.UTF_8));
        var out = new PrintStream(System.out, false, StandardCharsets.US_ASCII);
        for (String line = in.readLine(); line != null; line = in.readLine()) out.println(answer(line.split(" ")));
        out.flush();
    }
}
