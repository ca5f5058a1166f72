"""Mutated records of every form that is decoded: messages, tables, pictures, parameters, settings.

Each is refused in one line, or taken and then worked on; what was taken must be finite. A record of other content that
is valid counts as the same: nothing in a bare message tells that it was changed.
"""

from __future__ import annotations

import time

import cv2
import numpy as np

from faults.child_batches import run_in_children
from faults.file_records import file_forms
from faults.message_records import message_forms
from faults.mutation import mutated, mutated_text
from faults.record_form import Form, WrongValueTakenError
from faults.result import DIFFERENT, SAME, Result, Settings, Verdict, summed

NAME = 'records'


def run(settings: Settings) -> list[Result]:
    """Mutate records of each form."""
    cv2.setNumThreads(1)
    return [attack(settings, form, number) for number, form in enumerate((*message_forms(), *file_forms()))]


def attack(settings: Settings, form: Form, number: int) -> Result:
    """Tries of one form; SystemExit if the sound record is not taken, for then all tries would be refused like it."""
    started_s = time.monotonic()

    def sound(_: int) -> Verdict:
        form.take(form.sound, settings.folder / 'record_0')
        return Verdict(SAME)

    (verdict,) = run_in_children(1, sound)
    if verdict.word != SAME:
        raise SystemExit(f'error: {form.name}: the sound record is not taken: {verdict}')

    def attempt(index: int) -> Verdict:
        rng = np.random.default_rng([settings.seed, number, index])
        changed = mutated_text(form.sound, rng) if form.text else mutated(form.sound, rng)
        # Even and odd tries run at the same time.
        place = settings.folder / f'record_{index % 2}'
        try:
            form.take(changed, place)
        except WrongValueTakenError as error:
            return Verdict(DIFFERENT, str(error))
        return Verdict(SAME)

    verdicts = run_in_children(settings.tries(form.tries), attempt)
    return summed(NAME, f'mutated {form.name}', verdicts, time.monotonic() - started_s)
