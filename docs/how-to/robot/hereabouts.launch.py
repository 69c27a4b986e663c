"""Launch `hereabouts live` with the other nodes of a robot of ROS 2.

ros2 launch ./hereabouts.launch.py params:=hereabouts.yaml into:=kitchen.map
"""

from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration

HERE = Path(__file__).resolve().parent
ARGUMENTS = {
    "params": (str(HERE / "hereabouts.yaml"), "file of options"),
    "into": ("", "map, instead of that in the file"),
    "source": ("ros2", "where frames come from: ros2, ros2://DOMAIN, ws://HOST:PORT"),
    "program": ("hereabouts", "path of the command, e.g. /opt/hereabouts/bin/hereabouts"),
}


def live(context):
    """Return the process, by the file of options and the arguments."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    options = yaml.safe_load(Path(given["params"]).read_text()) or {}
    if given["into"]:
        options["into"] = given["into"]
    command = [given["program"], "live", given["source"]]
    for name, value in options.items():
        for one in value if isinstance(value, list) else [value]:
            if one is not False and one is not None:
                command += [f"--{name}"] if one is True else [f"--{name}", str(one)]
    # it ends after a whole frame: by SIGINT, and again if the second one comes late
    return [ExecuteProcess(cmd=command, name="hereabouts", output="screen", sigterm_timeout="20")]


def generate_launch_description():
    """Return arguments and process."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=live)])
