"""Plays a bag into the nodes: at a rate, or in lockstep, as fast as they answer and without dropped scans.

The recorded bytes are published unchanged.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import math
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import rclpy
import rclpy.signals
from rclpy.node import Node

from offradar_ros.entry_point import require_ordinary_files, run_guarded
from offradar_ros.errors import DataError, OffradarError
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.ros.answer_log import Answers
from offradar_ros.ros.initialise import end_on_hang_up, initialise, own_arguments, refusals_of_ros
from offradar_ros.ros.player import Player, PlayOptions
from offradar_ros.ros.session_client import SessionClient
from offradar_ros.ros.topic_hints import publishers
from offradar_ros.whole_file import write_whole_file


def _arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='replay_node', description='Play a bag into the offradar_ros nodes.')
    parser.add_argument('bag', type=Path, help='rosbag2 folder or file')
    parser.add_argument(
        '--topic',
        default='',
        metavar='NAME',
        help='topic of the polar scans, which is played on the input of the encoder',
    )
    parser.add_argument(
        '--positions',
        default='',
        metavar='NAME',
        help='topic of the positions, which is played on the input of the map server',
    )
    parser.add_argument('--rate', type=float, help='times real time (default 1)')
    parser.add_argument('--lockstep', action='store_true', help='send each scan when the one before it is answered')
    parser.add_argument('--loop', type=int, default=1, metavar='N', help='play N times; 0 plays until stopped')
    parser.add_argument('--restamp', action='store_true', help='stamp messages with the time at which they are sent')
    parser.add_argument('--session', action='store_true', help='start a mapping session before and end it after')
    parser.add_argument('--report', type=Path, metavar='FILE', help='write counts, latencies and seconds as JSON')
    parser.add_argument('--timeout', type=float, default=10.0, metavar='S', help='longest wait for an answer or a node')
    arguments = parser.parse_args(argv)
    if arguments.rate is not None and not 0.0 < arguments.rate <= 1000.0:
        parser.error(f'--rate: expected above 0 and at most 1000, got {arguments.rate:g}')
    if arguments.loop < 0:
        parser.error(f'--loop: expected 0 or more, got {arguments.loop}')
    if not 0.0 < arguments.timeout < math.inf:
        parser.error(f'--timeout: expected above 0, got {arguments.timeout:g}')
    if arguments.lockstep and (arguments.restamp or arguments.rate is not None):
        parser.error(
            '--lockstep: keeps the recorded stamps and goes as fast as the nodes answer: no --restamp or --rate'
        )
    if arguments.report and not arguments.report.parent.is_dir():
        parser.error(f'--report: no such folder: {arguments.report.parent}')
    return arguments


def _play(node: Node, argv: Sequence[str], arguments: argparse.Namespace) -> int:
    options = PlayOptions(
        arguments.rate or 1.0,
        arguments.lockstep,
        arguments.restamp,
        arguments.timeout,
        ChosenTopics(arguments.topic, arguments.positions),
    )
    answers, session = Answers(), ''
    with Bag(arguments.bag) as bag:
        player = Player(node, bag, options)
        player.wait_for_listeners()
        if arguments.session:
            print(SessionClient(node, arguments.timeout).start(), flush=True)
        started_s = time.monotonic()
        try:
            for _ in itertools.count() if arguments.loop == 0 else range(arguments.loop):
                player.play()
                answers += player.take_answers()
        except Exception:
            # An interrupt shuts the context down, and then any call may fail.
            if rclpy.ok():
                raise
            answers += player.take_answers()
            print('interrupted', flush=True)
        finally:
            seconds = time.monotonic() - started_s
            if arguments.session:
                session = _end_session(node, argv, arguments.timeout)
                print(session, flush=True)
        print(answers.summary(seconds), flush=True)
        if answers.answered_twice and rclpy.ok():
            counted = 'matches' if answers.matches else 'rejections'
            node.get_logger().warning(
                f'{answers.answered_twice} scans were answered twice: {counted} is published by '
                f'{publishers(node, counted)}: launched twice?'
            )
    if arguments.report:
        report = dataclasses.asdict(answers) | {'session': session, 'seconds': seconds}
        try:
            write_whole_file(arguments.report, json.dumps(report).encode())
        except OSError as error:
            raise DataError(f'{arguments.report}: the report cannot be written ({error.strerror})') from error
    if rclpy.ok():
        player.finish()
    return 1 if arguments.lockstep and answers.unanswered else 0


def _end_session(node: Node, argv: Sequence[str], timeout_s: float) -> str:
    if rclpy.ok():
        return SessionClient(node, timeout_s).end()
    # Interrupted: what was mapped so far is kept, even if the signal is sent again.
    rclpy.signals.uninstall_signal_handlers()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    context = rclpy.Context()
    rclpy.init(args=list(argv), context=context)
    again = rclpy.create_node('replay_end', context=context, enable_rosout=False)
    try:
        return SessionClient(again, timeout_s).end()
    finally:
        again.destroy_node()
        rclpy.shutdown(context=context)


def main(args: list[str] | None = None) -> int:
    """Entry point; exit status 1 if a scan in lockstep was not answered."""
    return run_guarded(lambda: _main(sys.argv if args is None else ['replay_node', *args]))


def _main(argv: list[str]) -> int:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_on_hang_up()
    arguments = _arguments(own_arguments(argv))
    require_ordinary_files(arguments.bag)
    node: Node | None = None
    try:
        initialise(argv)
        with refusals_of_ros():
            node = rclpy.create_node('replay')
        return _play(node, argv, arguments)
    except OffradarError:
        raise
    except Exception:
        # An interrupt shuts the context down, and then any call may fail.
        if rclpy.ok():
            raise
        return 0
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
