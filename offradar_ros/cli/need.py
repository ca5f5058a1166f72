"""What to do where a package that not every command needs is missing."""


def ros_hint(package: str, extra: str) -> str:
    """`needs …` for a package that a ROS 2 installation or an extra of ours brings."""
    return f'needs {package}: source a ROS 2 installation, or {pip_hint(extra)}'


def pip_hint(extra: str) -> str:
    """How to install an extra: the project is installed from its folder, not by a name."""
    return f"pip install '.[{extra}]' in the project's folder"
