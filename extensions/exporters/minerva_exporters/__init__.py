"""Records in the formats of other tools: tables, bags of ROS 2, Rerun, LeRobot.

datasets                  `export_dataset`, and the interface of the formats
sources                   what several formats read and check
rosbag                    a bag of ROS 2
rerun                     a file for Rerun
lerobot and the others    a data set of LeRobot
command, export_command   `minerva export`
"""

from minerva_bus.public_names import imported_at_first_use

TYPE_CHECKING = False
if TYPE_CHECKING:
    from minerva_exporters.datasets import Dataset, export_dataset

__getattr__ = imported_at_first_use(__name__, {"datasets": "Dataset export_dataset"})

__all__ = ["Dataset", "export_dataset"]
