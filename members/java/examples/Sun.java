import java.util.List;
import java.util.Map;

import minervabus.Event;
import minervabus.Generator;
import minervabus.Minerva;
import minervabus.Moment;

/** The sun shines in every frame: a generator without state. */
public final class Sun extends Generator {
    @Override
    protected List<String> generates() {
        return List.of("eSun");
    }

    @Override
    protected void tick(Moment moment) {
        moment.emit(Event.of("eSun", Map.of("heat", 0.2)));
    }

    public static void main(String[] arguments) {
        System.exit(Minerva.run(new Sun()));
    }
}
