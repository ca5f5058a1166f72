"""Changes of records: of any bytes, and of text by lines and cells."""

from __future__ import annotations

import struct

import numpy as np

HOSTILE_WORDS = (0, 1, 2**7, 2**15, 2**29, 2**31 - 1, 2**31, 2**32 - 1, 0x7FC00000, 0x7F800000, 0xFF800000)
HOSTILE_TEXT = (
    *(
        '',
        'nan',
        'inf',
        '-inf',
        '1e999',
        '-0',
        '9' * 400,
        '\0',
        ',',
        ';',
        '"',
        '\ufeff',
        '\n',
        '{',
        '[',
        '- ',
        '&a',
        '*a',
    ),
    *('!!python/object/apply:os.getpid []', '0x10', '1_000', '２', 'true', '~', '? ', '%', '\x85', '-1', '1e308', 'é'),
)


def mutated(record: bytes, rng: np.random.Generator) -> bytes:
    """A copy with a few bits, words or spans changed."""
    changed = bytearray(record)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(len(changed))) if changed else 0
        kind = int(rng.integers(7))
        if kind <= 1 and changed:
            changed[at] ^= 1 << int(rng.integers(8))
        elif kind == 2:
            at -= at % 4
            changed[at : at + 4] = struct.pack('<I', HOSTILE_WORDS[int(rng.integers(len(HOSTILE_WORDS)))])
        elif kind == 3:
            at -= at % 4
            value = (np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324)[int(rng.integers(6))]
            changed[at : at + 8] = struct.pack('<d', value)
        elif kind == 4:
            del changed[at : at + int(rng.integers(1, 65))]
        elif kind == 5:
            changed[at:at] = rng.integers(0, 256, int(rng.integers(1, 65)), np.uint8).tobytes()
        else:
            del changed[at:]
    return bytes(changed)


def mutated_text(record: bytes, rng: np.random.Generator) -> bytes:
    """A copy with a line or a token exchanged, or bytes changed."""
    if rng.random() < 0.3:
        return mutated(record, rng)
    lines = record.decode('utf-8').split('\n')
    at = int(rng.integers(len(lines)))
    separators = [c for c in ',: ' if c in lines[at]]
    if not separators or rng.random() < 0.2:
        other = int(rng.integers(len(lines)))
        lines[at], lines[other] = (lines[other], lines[at]) if rng.random() < 0.5 else (lines[other], lines[other])
    else:
        separator = separators[int(rng.integers(len(separators)))]
        cells = lines[at].split(separator)
        cells[int(rng.integers(len(cells)))] = HOSTILE_TEXT[int(rng.integers(len(HOSTILE_TEXT)))]
        lines[at] = separator.join(cells)
    return '\n'.join(lines).encode('utf-8')
