"""Build of the ament_python package; also a plain pip package.

Name, version, description, maintainer and licence are those of package.xml, their one place. Nothing is in [project] of
pyproject.toml: `colcon build --symlink-install` runs this file in a folder that has setup.py, setup.cfg and the
installed files, but no pyproject.toml.
"""

from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

MANIFEST = ElementTree.parse('package.xml').getroot()
MAINTAINER = MANIFEST.find('maintainer')
PACKAGE = MANIFEST.findtext('name')
PARAMS = sorted({path.parent for path in Path('params').rglob('*') if path.is_file()})
PYTHON_3 = (10, 11, 12, 13)
NODES = ('encoder_node', 'map_server_node', 'query_node', 'replay_node')

setup(
    name=PACKAGE,
    version=MANIFEST.findtext('version'),
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
    python_requires=f'>=3.{PYTHON_3[0]}',
    install_requires=[
        'setuptools',
        'backports.zstd>=1.0',
        'cattrs>=22.2',
        'lz4>=4.0',
        'numpy>=1.26',
        'onnxruntime>=1.18',
        'opencv-python-headless>=4.8',
        'pyproj>=3.6',
        'pyyaml>=6.0',
        'rich>=13.0',
        'rosbags>=0.11',
        'safetensors>=0.4',
        'scipy>=1.10',
        'typer>=0.9',
    ],
    extras_require={
        'bench': ['faiss-cpu>=1.8'],
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
        'torch': ['torch>=2.4', 'onnx>=1.16'],
    },
    zip_safe=False,
    maintainer=MAINTAINER.text,
    maintainer_email=MAINTAINER.get('email'),
    description=MANIFEST.findtext('description'),
    license=MANIFEST.findtext('license'),
    classifiers=[f'Programming Language :: Python :: 3.{minor}' for minor in PYTHON_3],
    package_data={PACKAGE: ['py.typed', 'weights/*', 'lab/report/*.jinja']},
    entry_points={
        'console_scripts': [
            f'offradar = {PACKAGE}.cli.main:main',
            *(f'{node} = {PACKAGE}.nodes.{node}:main' for node in NODES),
        ],
    },
)
