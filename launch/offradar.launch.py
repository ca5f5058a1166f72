"""The three nodes: `ros2 launch offradar_ros offradar.launch.py map:=/data/town.db`."""

import os
from pathlib import Path

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchContext, LaunchDescription

# Read by Jazzy's Fast DDS; other middlewares ignore it.
DDS_PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'

RESPAWN_DELAY_S = 2.0


def require_parameter_file(context: LaunchContext) -> None:
    """RuntimeError, which ends the launch with one line, without a file: launch would start the nodes at defaults."""
    path = Path(LaunchConfiguration('params').perform(context))
    if not path.is_file():
        raise RuntimeError(f'params:={path}: no such file: expected a parameter file, by its whole path')
    if not os.access(path, os.R_OK):
        raise RuntimeError(f'params:={path}: cannot be read: change its permissions')


def start_nodes(context: LaunchContext) -> list[Node]:
    """Encoder, map server and query node in one namespace; what is not given is as the parameter file says."""

    def node(
        executable: str, name: str, own: dict[str, tuple[str, type]], remappings: list[tuple[object, object]]
    ) -> Node:
        parameters = {
            parameter: ParameterValue(LaunchConfiguration(argument), value_type=kind)
            for parameter, (argument, kind) in (own | {'use_sim_time': ('use_sim_time', bool)}).items()
            if LaunchConfiguration(argument).perform(context)
        }
        return Node(
            package='offradar_ros',
            executable=executable,
            name=name,
            namespace=LaunchConfiguration('namespace'),
            output='screen',
            parameters=[LaunchConfiguration('params'), *([parameters] if parameters else [])],
            remappings=remappings,
            respawn=LaunchConfiguration('respawn'),
            respawn_delay=RESPAWN_DELAY_S,
            # For these nodes alone: a launch file that includes this one may have others.
            additional_env={DDS_PROFILE: LaunchConfiguration('dds_profile')},
        )

    scans = ('radar_data/b_scan_image', LaunchConfiguration('scans'))
    # As image_transport names it; remapping the one does not remap the other.
    compressed = ('radar_data/b_scan_image/compressed', [LaunchConfiguration('scans'), '/compressed'])
    fixes = ('gps/fix', LaunchConfiguration('fixes'))
    odometry = ('ground_truth/odometry', LaunchConfiguration('odometry'))
    vehicle_odometry = ('odometry', LaunchConfiguration('vehicle_odometry'))
    return [
        node('encoder_node', 'encoder', {}, [scans, compressed]),
        node('map_server_node', 'map_server', {'map.path': ('map', str)}, [fixes, odometry]),
        node('query_node', 'query', {'query.map_path': ('map', str)}, [vehicle_odometry]),
    ]


def generate_launch_description() -> LaunchDescription:
    """Encoder, map server and query node."""
    shipped = PathJoinSubstitution([FindPackageShare('offradar_ros'), 'params', 'fastdds.xml'])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'params',
                default_value=PathJoinSubstitution([FindPackageShare('offradar_ros'), 'params', 'offradar.yaml']),
                description='parameter file, as `offradar calibrate` or `offradar parameters --out` writes it',
            ),
            DeclareLaunchArgument(
                'map', default_value='', description='SQLite file of the map; if empty, as the parameter file says'
            ),
            DeclareLaunchArgument('namespace', default_value='', description='namespace of the nodes and topics'),
            DeclareLaunchArgument(
                'use_sim_time',
                default_value='',
                description='true to follow /clock, or false; if empty, as the parameter file says',
            ),
            DeclareLaunchArgument(
                'scans', default_value='radar_data/b_scan_image', description='topic of the polar images'
            ),
            DeclareLaunchArgument('fixes', default_value='gps/fix', description='topic of the positions'),
            DeclareLaunchArgument(
                'odometry',
                default_value='ground_truth/odometry',
                description='topic of the positions where position.source is odometry',
            ),
            DeclareLaunchArgument(
                'vehicle_odometry',
                default_value='odometry',
                description='topic of the odometry from which localisation takes how far the vehicle drives',
            ),
            DeclareLaunchArgument(
                'dds_profile',
                # An empty variable counts as not set, as in the rest of this package.
                default_value=os.environ.get(DDS_PROFILE) or shipped,
                description='XML profile of Fast DDS; ours, unless the environment names one, has room for scans',
            ),
            DeclareLaunchArgument(
                'respawn',
                default_value='false',
                description='true starts a node again, 2 s after it has ended, whatever the reason',
            ),
            OpaqueFunction(function=require_parameter_file),
            OpaqueFunction(function=start_nodes),
        ]
    )
