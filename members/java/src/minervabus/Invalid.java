package minervabus;

/** A message that cannot be read, or a value that cannot be sent. */
public final class Invalid extends RuntimeException {
    private static final long serialVersionUID = 1L;

    Invalid(String message) {
        super(message);
    }
}
