"""Plays a bag into the nodes: at a rate, or in lockstep, as fast as they answer and with nothing dropped.

The recorded bytes are published as they are, never decoded and encoded again.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from offradar_ros.bags.reader import Bag
from offradar_ros.errors import OffradarError
from offradar_ros.ros.replay import Answers, Player, PlayOptions
from offradar_ros.ros.sessions import SessionClient


def _arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='replay_node', description='Play a bag into the offradar_ros nodes.')
    parser.add_argument('bag', type=Path, help='rosbag2 folder')
    parser.add_argument('--rate', type=float, default=1.0, help='times real time (default 1)')
    parser.add_argument('--lockstep', action='store_true', help='send each scan when the one before it is answered')
    parser.add_argument('--loop', type=int, default=1, metavar='N', help='play N times; 0 plays until stopped')
    parser.add_argument('--restamp', action='store_true', help='stamp messages with the time at which they are sent')
    parser.add_argument('--session', action='store_true', help='start a mapping session before and end it after')
    parser.add_argument('--report', type=Path, metavar='FILE', help='write counts and latencies as JSON')
    parser.add_argument('--timeout', type=float, default=10.0, metavar='S', help='longest wait for an answer or a node')
    arguments = parser.parse_args(argv)
    if not 0.0 < arguments.rate <= 1000.0:
        parser.error(f'--rate: expected above 0 and at most 1000, got {arguments.rate:g}')
    if arguments.loop < 0:
        parser.error(f'--loop: expected 0 or more, got {arguments.loop}')
    if arguments.restamp and arguments.lockstep:
        parser.error('--restamp: a replay in lockstep keeps the recorded stamps')
    return arguments


def _play(node: Node, arguments: argparse.Namespace) -> int:
    options = PlayOptions(arguments.rate, arguments.lockstep, arguments.restamp, arguments.timeout)
    with Bag(arguments.bag) as bag:
        player = Player(node, bag, options)
        player.wait_for_listeners()
        sessions = SessionClient(node, arguments.timeout) if arguments.session else None
        started_s = time.monotonic()
        answers = Answers()
        if sessions:
            print(sessions.start(), flush=True)
        loops = iter(functools.partial(int, 1), 0) if arguments.loop == 0 else range(arguments.loop)
        for _ in loops:
            answers += player.play()
        session = sessions.end() if sessions else ''
        if session:
            print(session, flush=True)
        if arguments.report:
            arguments.report.write_text(json.dumps(dataclasses.asdict(answers) | {'session': session}), 'utf-8')
        print(answers.summary(time.monotonic() - started_s), flush=True)
    return 1 if arguments.lockstep and answers.unanswered else 0


def main(args: list[str] | None = None) -> int:
    """Entry point; exit status 1 if a scan in lockstep was not answered."""
    argv = sys.argv if args is None else ['replay_node', *args]
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    arguments = _arguments(remove_ros_args(argv)[1:])
    rclpy.init(args=argv)
    node = rclpy.create_node('replay')
    try:
        return _play(node, arguments)
    except ExternalShutdownException:
        return 0
    except OffradarError as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
