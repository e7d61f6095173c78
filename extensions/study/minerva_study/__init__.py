"""Models and studies: many runs of a world, to find its best string or to compare its options.

studies, study_tables      `sweep`: all combinations of options, and its table
branching, branch_point    `branch`: a record continues in many ways
calibrating, search_space  `calibrate`: a search for values by Optuna
evolving, evolution        `evolve_strings`: a genetic algorithm over strings
mutation                   random changes of a string
worker_pool, executor_pool where the runs are: processes, or executors such as Dask
placed                     `Placed`: agents of the plane with a picture, in few lines
journal                    finished runs, with which a study continues after a kill
"""

from minerva_bus.public_names import imported_at_first_use

TYPE_CHECKING = False
if TYPE_CHECKING:
    from minerva_study.branching import branch
    from minerva_study.calibrating import Calibration, calibrate
    from minerva_study.evolving import evolve_strings
    from minerva_study.placed import Placed
    from minerva_study.studies import sweep

__getattr__ = imported_at_first_use(
    __name__,
    {
        "branching": "branch",
        "calibrating": "Calibration calibrate",
        "evolving": "evolve_strings",
        "placed": "Placed",
        "studies": "sweep",
    },
)

__all__ = ["Calibration", "Placed", "branch", "calibrate", "evolve_strings", "sweep"]
