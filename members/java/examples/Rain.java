import java.util.List;
import java.util.Map;

import minervabus.Event;
import minervabus.Generator;
import minervabus.Minerva;
import minervabus.Moment;

/** Rain in every second frame: a generator that counts its showers, also across a restart. */
public final class Rain extends Generator {
    private long showers;

    @Override
    protected List<String> generates() {
        return List.of("eRain");
    }

    @Override
    protected void tick(Moment moment) {
        if (moment.frame() % 2 != 0) return;
        showers++;
        moment.emit(Event.of("eRain"));
    }

    @Override
    protected Map<String, ?> save() {
        return Map.of("showers", showers);
    }

    @Override
    protected void restore(Map<String, ?> saved) {
        showers = (Long) saved.get("showers");
    }

    @Override
    protected Map<String, ?> report() {
        return save();
    }

    public static void main(String[] arguments) {
        System.exit(Minerva.run(new Rain()));
    }
}
