"""The unit that the name of a column carries, and the names of columns of times.

The unit stands in brackets (``Time (ms)``, ``x [mm]``), behind a slash or ``in`` (``x / mm``, ``Weg in mm``), or among
the words of the name, at its end as a rule (``tip_mm``, ``Time ms``, ``acc_m_s2``, ``v_mm_per_s``, ``x_mm_raw``).  The
first word names the quantity.  Of the other words, the longest run that denotes a unit counts.  A run that may be part
of another unit, as in ``x_mm_per_rev``, ``force_N_m`` or ``area_mm2``, is doubtful, and the caller is asked.
"""

from __future__ import annotations

import re

from ancf_casadi.records.units import OVER, TOKENS, Unit, parse_unit, plain_text, powers

BRACKETS = re.compile(r"[(\[{<]([^()\[\]{}<>]*)[)\]}>]")
AMBIGUOUS_UNITS = {"min", "h", "in", "g", "gs", "grad", "mil"}  # as the whole name of a column, these are rarely units
SEPARATING = " _.,·⋅*-"
TIME_NAMES = re.compile(
    r"(?:elapsed|relative|rel\.?|abs\.?|absolute|sample|test|run|local|system)?[ _]*"
    r"(?:t|times?|zeit|temps|tiempo|tempo|tid|tijd|aika|time[ _-]?stamps?|date[ _/-]?time|uhrzeit|messzeit|"
    r"seconds|secs?|milliseconds|x_value)",
    re.IGNORECASE,
)
BEFORE_UNIT = re.compile(r" ?[(\[{</,]| in |[_ ](?=[^_ ]*$)")


def unit_in_name(name: str) -> tuple[str, Unit | None]:
    """Return the unit that the name of a column carries, as it is written there, and its meaning.

    The text is empty if the name carries no unit; the meaning is None if the unit is not understood.
    """
    bracketed = [text.strip() for text in BRACKETS.findall(name)]
    for text in bracketed:
        if parse_unit(text):
            return text, parse_unit(text)
    if bracketed and name.rstrip()[-1] in ")]}>":
        return bracketed[-1], None
    written = " ".join(name.split()).replace("**", "^")
    tokens = TOKENS.findall(plain_text(name))
    items = [k for k, token in enumerate(tokens) if token.strip(SEPARATING)]
    runs = _runs(tokens, items)
    doubtful = _doubtful(tokens, items, runs)
    if not runs and not doubtful:
        return "", None
    places = [*(place for begin, end in runs for place in (begin, end - 1)), *doubtful]
    begin, end = (sum(map(len, tokens[:k])) for k in (min(places), max(places) + 1))
    text = written[begin:end].strip()
    return text, None if doubtful or len(runs) > 1 else parse_unit(text)


def unit_of(written: str, name: str) -> tuple[str, Unit | None]:
    """Return the unit of a column, as it is written, and its meaning: the one beside its name, or the one in it."""
    return (written, parse_unit(written)) if written else unit_in_name(name)


def _runs(tokens: list[str], items: list[int]) -> list[tuple[int, int]]:
    """Return begin and end of each run of tokens that denotes a unit: all of them, or from the second word on."""
    if parse_unit("".join(tokens)) and "".join(tokens) not in AMBIGUOUS_UNITS:
        return [(0, len(tokens))]
    runs: list[tuple[int, int]] = []
    for n, begin in enumerate(items):
        if n == 0 or not powers(tokens[begin]) or (runs and begin < runs[-1][1]):
            continue
        # words of the longest spelling, such as m per second per second
        ends = [k + 1 for k in reversed(items[n : n + 5]) if parse_unit("".join(tokens[begin : k + 1]))]
        if not ends or (tokens[begin] == "in" and parse_unit("".join(tokens[begin + 1 : ends[0]]).lstrip(SEPARATING))):
            continue  # the preposition, as in Weg in mm
        certain = begin == items[-1] or (len(tokens[begin]) > 1 and tokens[begin] not in AMBIGUOUS_UNITS)
        if certain or ends[0] > begin + 1:
            runs.append((begin, ends[0]))
    return runs


def _doubtful(tokens: list[str], items: list[int], runs: list[tuple[int, int]]) -> list[int]:
    """Return the places outside the runs that may belong to a unit that is not understood."""
    inside = {k for begin, end in runs for k in range(begin, end)}
    places: list[int] = []
    for before, place, after in zip([None, *items], items, [*items[1:], None], strict=False):
        word = tokens[place]
        left, right = ("" if k is None else tokens[k] for k in (before, after))
        if place in inside:
            continue
        if word.strip() in OVER:  # x_mm/rev, counts per mm; but s / mm is the quantity s in mm
            quantity = before == 0 or word != word.strip()
            over = before in inside or (parse_unit(left) and not quantity)
            if over or (word == "per" and parse_unit(right)):
                places += [k for k in (before, place, after) if k is not None]
        elif parse_unit(word):  # force_N_m is a moment or a force per length
            pairs = [(a, b) for a, b in ((left, word), (word, right)) if a and b and a != "in"]
            if any(parse_unit(f"{a} {b}") or parse_unit(f"{a}/{b}") for a, b in pairs):
                places.append(place)
        elif word == "2" and before in inside:  # acc_m_s_2
            begin, end = next(run for run in runs if run[0] <= before < run[1])
            if parse_unit("".join(tokens[begin:end]) + word):
                places.append(place)
        elif before is not None and powers(word):
            symbol = word.rstrip("0123456789")
            if parse_unit(left):
                places += [before, place]
            elif (len(symbol) > 1 and symbol not in AMBIGUOUS_UNITS) or left.strip() in OVER:
                places.append(place)
    return places


def names_time(name: str) -> bool:
    """Return whether the name of a column, without its unit, is one for times."""
    single = " ".join(name.split())
    bare = BEFORE_UNIT.split(single, maxsplit=1)[0] if unit_in_name(name)[0] else single
    return TIME_NAMES.fullmatch(bare) is not None
