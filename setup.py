"""Build of the ament_python package; also a plain pip package."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = 'offradar_ros'
PARAMS = sorted({path.parent for path in Path('params').rglob('*') if path.is_file()})
NODES = ('encoder_node', 'map_server_node', 'query_node', 'replay_node')

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        *(
            (f'share/{PACKAGE}/{folder}', sorted(str(path) for path in folder.iterdir() if path.is_file()))
            for folder in PARAMS
        ),
        (f'share/{PACKAGE}/launch', sorted(map(str, Path('launch').glob('*.launch.py')))),
        # Wheels ignore setup.cfg's install_scripts: these files are what `ros2 run` finds after `pip install`.
        (f'lib/{PACKAGE}', [f'scripts/{name}' for name in (*NODES, 'offradar')]),
    ],
    python_requires='>=3.10',
    install_requires=[
        'setuptools',
        'cattrs>=22.2',
        'numpy>=1.26',
        'opencv-python-headless>=4.8',
        'pyproj>=3.6',
        'pyyaml>=6.0',
        'rich>=13.0',
        'rosbags>=0.11',
        'scipy>=1.10',
        'typer>=0.9',
    ],
    extras_require={
        'bench': ['faiss-cpu>=1.8'],
        'onnx': ['onnxruntime>=1.18', 'safetensors>=0.4'],
        'plot': ['jinja2>=3.0', 'matplotlib>=3.6'],
        'ros': ['ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces'],
        'test': [
            'hypothesis',
            'mcap',
            'mcap-ros2-support',
            'mypy',
            'pytest',
            'pytest-timeout',
            'pytest-xdist',
            'ruff',
            'scikit-learn',
            'types-PyYAML',
        ],
        'torch': ['torch>=2.4', 'safetensors>=0.4', 'onnx>=1.16'],
    },
    zip_safe=False,
    maintainer='offradar_ros maintainers',
    maintainer_email='maintainers@offradar-ros.example',
    description='Uncertainty-aware radar place recognition with map maintenance and introspective querying',
    license='Apache-2.0',
    package_data={PACKAGE: ['py.typed', 'weights/*', 'lab/report/*.jinja']},
    entry_points={
        'console_scripts': [
            f'offradar = {PACKAGE}.cli.main:main',
            *(f'{node} = {PACKAGE}.nodes.{node}:main' for node in NODES),
        ],
    },
)
