"""Records and worlds: replays, causes of values, differences, tables, pictures, graphs.

records, explaining, causes   `explain`: how a value came about; `diff`, `replay`, `replay_views`
replays, replay_algorithm     `replay`: a record in any view, and its agents again
comparing                     the first difference between two runs
frame_texts                   frames of a record as text
past_frames                   frames of a record that are computed again
bisection, first_cause        `bisect`: why two runs part
swapping                      `swap`: a recorded run again with one member replaced
halts                         why a running world does not advance
record_tables, table_files    `export`: tables of what was not collected while a world ran
record_plot, tracks           pictures of runs
series_plot, tables           plots of tables, also of those in files
plotting                      what all plots share: style, axes, files
graphs, emitted               `graph`: who publishes and who receives which event types
"""

from minerva_bus.public_names import imported_at_first_use

TYPE_CHECKING = False
if TYPE_CHECKING:
    from minerva_analysis.bisection import Parting, bisect
    from minerva_analysis.graphs import Graph, graph
    from minerva_analysis.record_tables import Export, export
    from minerva_analysis.records import diff, explain, replay, replay_views
    from minerva_analysis.swapping import replay_swapped

_HOMES = {
    "bisection": "Parting bisect",
    "graphs": "Graph graph",
    "record_tables": "Export export",
    "records": "diff explain replay replay_views",
    "swapping": "replay_swapped",
}
__getattr__ = imported_at_first_use(__name__, _HOMES)

__all__ = [
    "Export",
    "Graph",
    "Parting",
    "bisect",
    "diff",
    "explain",
    "export",
    "graph",
    "replay",
    "replay_swapped",
    "replay_views",
]
