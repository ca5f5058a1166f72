"""Checks an SQLite file of rosbag2: its pages are in order, and nothing in it is beyond bounds.

SQLite files have no checksums: damage within a message is not seen.
"""

from __future__ import annotations

import contextlib
import sqlite3
import urllib.parse
from collections import Counter
from pathlib import Path

from offradar_ros.recordings.bags.bag_facts import BagFacts
from offradar_ros.recordings.bags.inflate import MAX_BYTES, inflate_message
from offradar_ros.recordings.bags.mcap_check import MAX_CHANNELS
from offradar_ros.recordings.bags.mcap_records import Damage


def check_sqlite(path: Path, compressed_messages: bool = False) -> BagFacts:
    """The facts of a file; Damage if it is not in order.

    `compressed_messages`: each message is compressed by itself.
    """
    # Immutable: no journal is looked for and no lock is taken, as rosbags does.
    uri = f'file:{urllib.parse.quote(str(path))}?mode=ro&immutable=1'
    try:
        with contextlib.closing(sqlite3.connect(uri, uri=True)) as connection:
            connection.execute('PRAGMA trusted_schema = OFF')
            return _facts(connection, compressed_messages)
    except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
        raise Damage(str(error)) from error


def _facts(connection: sqlite3.Connection, compressed_messages: bool) -> BagFacts:
    (found,) = connection.execute('PRAGMA quick_check(1)').fetchone()
    if found != 'ok':
        raise Damage(' '.join(str(found).split())[:200])
    tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not {'messages', 'topics'} <= tables:
        raise Damage('it has no tables messages and topics of rosbag2')
    (topics,) = connection.execute('SELECT count(*) FROM topics').fetchone()
    if topics > MAX_CHANNELS:
        raise Damage(f'more than {MAX_CHANNELS} topics')
    longest, first_ns, last_ns, strange = connection.execute(
        'SELECT max(length(data)), min(timestamp), max(timestamp),'
        " total(typeof(data) != 'blob' OR typeof(timestamp) != 'integer'"
        ' OR topic_id NOT IN (SELECT id FROM topics)) FROM messages'
    ).fetchone()
    if strange:
        raise Damage(f'{strange:.0f} messages without data, time or topic')
    if (longest or 0) > MAX_BYTES:
        raise Damage(f'a message of more than {MAX_BYTES} bytes')
    if compressed_messages:
        for (data,) in connection.execute('SELECT data FROM messages'):
            try:
                inflate_message(data)
            except ValueError as error:
                raise Damage(str(error)) from error
    counts: Counter[tuple[str, str]] = Counter()
    for name, kind, count in connection.execute(
        'SELECT name, type, count(*) FROM messages JOIN topics ON topics.id = topic_id GROUP BY topics.id'
    ):
        counts[str(name), str(kind)] += count
    return BagFacts(counts, first_ns or 0, last_ns + 1 if counts else 0)
