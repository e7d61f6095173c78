import java.io.IOException;
import java.io.UncheckedIOException;
import java.nio.file.Files;
import java.nio.file.Path;
import java.util.List;
import java.util.Locale;
import java.util.Map;

import minervabus.Device;
import minervabus.Minerva;
import minervabus.View;

/** Draws the garden as SVG: an observer. The file is the first argument, or garden.svg. */
public final class Picture extends Device {
    private final Path file;
    private int shells;

    private Picture(Path file) {
        this.file = file;
    }

    @Override
    protected List<String> draws() {
        return List.of("eShow");
    }

    @Override
    protected String when() {
        return "each 10 frames";
    }

    @Override
    protected void draw(View view) {
        shells = view.nodes().size();
        int width = 10 + 30 * Math.max(shells, 5);
        var svg = new StringBuilder();
        svg.append("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %d 60\">".formatted(width));
        svg.append("<text x=\"5\" y=\"12\" font-size=\"10\" font-family=\"sans-serif\">");
        svg.append("frame %d: %d snails</text>".formatted(view.frame(), shells));
        for (int n = 0; n < shells; n++) {
            double size = (Double) view.nodes().get(n).values().get("size");
            var circle = "<circle cx=\"%d\" cy=\"40\" r=\"%.4f\" fill=\"#886644\"/>";
            svg.append(String.format(Locale.ROOT, circle, 20 + 30 * n, 2 * size));
        }
        write(svg.append("</svg>\n").toString());
    }

    private void write(String svg) {
        try {
            Files.writeString(file, svg);
        } catch (IOException error) {
            throw new UncheckedIOException(error);
        }
    }

    @Override
    protected Map<String, ?> report() {
        return Map.of("shells", shells);
    }

    public static void main(String[] arguments) {
        System.exit(Minerva.run(new Picture(Path.of(arguments.length > 0 ? arguments[0] : "garden.svg"))));
    }
}
