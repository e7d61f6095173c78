package minervabus;

import java.util.List;

/**
 * What a device draws.
 *
 * @param type the visual event type
 * @param frame the frame with whose string it was made
 * @param nodes of the whole string, in reading order
 * @param halted ids of agents whose steps do not count in this frame
 */
public record View(String type, long frame, List<Node> nodes, List<String> halted) {}
