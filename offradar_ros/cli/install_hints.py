"""How to install packages that only some commands need."""


def ros_hint(package: str, extra: str) -> str:
    """`needs …`, for a package that comes with a ROS 2 installation or with an extra of this project."""
    return f'needs {package}: source a ROS 2 installation, or {pip_hint(extra)}'


def pip_hint(extra: str) -> str:
    """How to install an extra: the project is installed from its folder, not by a name."""
    return f"pip install '.[{extra}]' in the project's folder"
