"""Compiled reading of sentences against the regular expressions, which read any sentence."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.gnss.sentences import nmea
from tpmsd.onboard.sources.gnss import nmea_sentence
from tpmsd.onboard.sources.gnss.nmea_sentence import SentenceError, decode_sentence

DIGITS = st.from_regex(r"[0-9]{0,9}(\.[0-9]{0,9})?", fullmatch=True)
ODD = st.text(alphabet="0123456789.+-,ANSEWV \t\x1c~é", max_size=8)
NUMBERS = st.one_of(
    DIGITS,
    st.from_regex(r"[+-]?[0-9]{0,20}\.?[0-9]{0,20}", fullmatch=True),
    st.sampled_from(["", ".", "-", "-0", "0", "360", "360.0", "360.1", "1e3", "999", "00.5"]),
)
TIMES = st.one_of(
    st.from_regex(r"[0-2][0-9][0-5][0-9][0-6][0-9](\.[0-9]{0,4})?", fullmatch=True),
    st.sampled_from(["", "235960.5", "240000", "126000", "12345", "1234567", "120000.0000000000000001"]),
)
LATITUDES = st.one_of(
    st.from_regex(r"[0-9]{4}\.[0-9]{0,9}", fullmatch=True),
    st.sampled_from(["", "9000", "9000.0001", "0000.0", "4860.0", "123.4", "12.3", "18000", "123456.7"]),
)
SIDES = st.sampled_from(["N", "S", "E", "W", "", "n", "NS", "X"])
DATES = st.one_of(
    st.from_regex(r"[0-3][0-9][01][0-9][0-9]{2}", fullmatch=True),
    st.sampled_from(
        ["", "290200", "290201", "310424", "010180", "311279", "320124", "000024", "01012", "0101245"]
    ),
)
MODES = st.sampled_from(["", *"ADPRFEMSNadVX", "AN", "5"])
PLACES = [LATITUDES, SIDES, LATITUDES, SIDES]
COLUMNS: dict[str, list[st.SearchStrategy[str]]] = {
    "RMC": [TIMES, MODES | st.just("V"), *PLACES, NUMBERS, NUMBERS, DATES, NUMBERS, SIDES, MODES],
    "GGA": [TIMES, *PLACES, st.sampled_from([*"0123456789", "", "12", "A"]), *[NUMBERS] * 3, SIDES, NUMBERS],
    "VTG": [NUMBERS, SIDES, NUMBERS, SIDES, NUMBERS, SIDES, NUMBERS, SIDES, MODES],
    "ZDA": [TIMES, NUMBERS, NUMBERS, NUMBERS],
    "GLL": [*PLACES, TIMES, MODES, MODES],
    "GSV": [NUMBERS, NUMBERS],
}
TALKERS = st.sampled_from(["GP", "GN", "G1", "PG", "gp", "P"])


def bodies(kind: str) -> st.SearchStrategy[str]:
    """Address and fields of one kind: most in their usual form, some missing or added."""
    fields = st.tuples(*[st.one_of(column, column, column, ODD) for column in COLUMNS[kind]])
    return st.builds(
        lambda talker, fields, end, more: ",".join([talker + kind, *fields[: len(fields) - end], *more]),
        TALKERS,
        fields,
        st.sampled_from([0, 0, 0, 1, 2, 5]),
        st.lists(ODD, max_size=3),
    )


BODIES = st.sampled_from(sorted(COLUMNS)).flatmap(bodies)


def said(line: bytes) -> str:
    """Values or refusal of a line, to the last bit."""
    try:
        return repr(decode_sentence(line))
    except SentenceError as error:
        return f"{error.kind}: {error.detail}"


def by_text(line: bytes) -> str:
    """The same where nothing is compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nmea_sentence, "compiled", None)
        return said(line)


@settings(derandomize=True, deadline=None, max_examples=2000)
@given(BODIES, st.sampled_from([b"", b"", b"\r\n", b" ", b"0"]))
def test_sentences_are_read_alike(body: str, end: bytes) -> None:
    """Whatever the fields hold, values and refusals are those of the regular expressions."""
    line = nmea(body) + end
    assert by_text(line) == said(line)


@settings(derandomize=True, deadline=None)
@given(BODIES, st.integers(0, 200), st.integers(0, 255), st.integers(0, 200))
def test_damaged_sentences_are_read_alike(body: str, place: int, byte: int, cut: int) -> None:
    """So are those with one wrong byte, of which the checksum may be true by chance, and those cut short."""
    line = bytearray(nmea(body))
    line[place % len(line)] = byte
    for damaged in (bytes(line), nmea(body)[: cut % len(line)], nmea(body).lower()):
        assert by_text(damaged) == said(damaged)


def test_the_usual_sentences_are_read_by_compiled_code() -> None:
    """Sound sentences of receivers are, with empty fields too; others are left to the expressions."""
    compiled = nmea_sentence.compiled
    if compiled is None:
        pytest.skip("it is not built here (no compiler, or no headers of Python)")
    usual = (
        "GNRMC,080000.000,A,5006.600087,N,00840.798954,W,0.031,359.9,290224,,,A",
        "GPGGA,235960.50,5006.6,S,00840.7,E,4,17,0.69,-114.59,M,-47.00,M,,",
        "GPGGA,080000.00,,,,,0,00,,,M,,M,,",
        "GNVTG,,T,,M,4.320,N,8.000,K,A",
        "GPGSV,3,1,12,01,40,083,46",
    )
    other = ("GNZDA,080000.00,01,07,2024,00,00", "GPRMC,080000,A,5060.0,N,00840.7,E,1,2,010724,,", "PUBX,00")
    assert [True] * 5 == [compiled.decode(nmea(body), math.nan) is not None for body in usual]
    assert [False] * 3 == [compiled.decode(nmea(body), math.nan) is not None for body in other]
    assert (
        compiled.decode(b"", math.nan) is None
        and compiled.decode(nmea(usual[0])[:-1] + b"0", math.nan) is None
    )
    with pytest.raises(TypeError, match="bytes-like"):
        compiled.decode("$GNVTG", math.nan)
    with pytest.raises(ValueError, match="two arguments"):
        compiled.decode(b"$GNVTG")
