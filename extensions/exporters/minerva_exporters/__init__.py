"""Records as tables, and in the formats of other tools: bags of ROS 2, Rerun, LeRobot.

record_tables             `export`: tables of what was not collected while the world ran
table_files               its files, which appear when they are complete
datasets                  `export_dataset`, and the interface of the formats
sources                   what several formats read and check
rosbag, ros_readings      a bag of ROS 2
rerun                     a file for Rerun
lerobot and the others    a data set of LeRobot
command, export_command   `minerva export`
"""

from minerva_bus.public_names import imported_at_first_use

TYPE_CHECKING = False
if TYPE_CHECKING:
    from minerva_exporters.datasets import Dataset, export_dataset
    from minerva_exporters.record_tables import Export, export

__getattr__ = imported_at_first_use(
    __name__, {"datasets": "Dataset export_dataset", "record_tables": "Export export"}
)

__all__ = ["Dataset", "Export", "export", "export_dataset"]
