"""Checksums of an MCAP file: of each chunk, of all up to the summary, and of the summary.

Together they cover every byte of the file. rosbags leaves them out.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

from offradar_ros.recordings.bags.mcap_records import (
    CHECKSUM_IN_CHUNK,
    CHUNK,
    DATA_END,
    FOOTER,
    Damage,
    body_of,
    checksum_of,
    open_chunk,
    top_records,
)

CHECKSUM_IN_FOOTER = 16
"""Where the checksum is in the body of a footer: that of the summary up to there."""


def write_checksums(path: Path) -> None:
    """Fill in the checksums of a complete file; Damage if it is none, OSError if it cannot be written."""
    data_end = footer = None
    with path.open('r+b') as file:
        for record in top_records(file):
            if record.kind == CHUNK:
                _, content = open_chunk(body_of(file, record))
                file.seek(record.body + CHECKSUM_IN_CHUNK)
                file.write(struct.pack('<I', zlib.crc32(content)))
            elif record.kind == DATA_END:
                data_end = record
            elif record.kind == FOOTER:
                footer = record
        if data_end is None or footer is None or data_end.length != 4:
            raise Damage('no end of its data')
        found = checksum_of(file, 0, data_end.start)
        file.seek(data_end.body)
        file.write(struct.pack('<I', found))
        (summary_start,) = struct.unpack_from('<Q', body_of(file, footer))
        found = checksum_of(file, summary_start or footer.start, footer.body + CHECKSUM_IN_FOOTER)
        file.seek(footer.body + CHECKSUM_IN_FOOTER)
        file.write(struct.pack('<I', found))
