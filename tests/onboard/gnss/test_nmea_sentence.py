from __future__ import annotations

import math
from functools import reduce
from operator import xor

import pynmea2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.gnss.sentences import gga, nmea, rmc, vtg
from tpmsd.onboard.sources.gnss.nmea_sentence import (
    COLUMNS,
    NmeaReading,
    SentenceError,
    decode_sentence,
    exclusive_or,
)

T = 1720716104.3


def test_published_rmc():
    """The textbook's RMC sentence decodes to its known values."""
    reading = decode_sentence(b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A")
    assert 12 * 3600 + 35 * 60 + 19 == reading.time_of_day_s
    assert 8847 == reading.unix_day  # 1994-03-23
    assert pytest.approx(48.1173, abs=1e-12) == reading.latitude_deg
    assert pytest.approx(11 + 31 / 60, abs=1e-12) == reading.longitude_deg
    assert pytest.approx(22.4 * 1852 / 3600, abs=1e-12) == reading.speed_mps
    assert pytest.approx(math.radians(84.4), abs=1e-12) == reading.course_rad
    assert (True, 1) == (reading.valid, reading.quality)


def test_published_gga():
    """The textbook's GGA sentence decodes, its height above the ellipsoid by the geoid's separation."""
    reading = decode_sentence(b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47")
    assert pytest.approx(545.4 + 46.9) == reading.altitude_m
    assert (0.9, 1, True) == (reading.hdop, reading.quality, reading.valid)


def test_blanks_around_fields_are_no_part_of_them():
    """Some receivers pad their fields; a speed with blanks around it is the speed."""
    body = "GNRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W,A"
    padded = body.replace("022.4", " 022.4 ").replace(",A,48", ", A,48").replace(",N,", ",N ,")

    assert decode_sentence(nmea(body)) == decode_sentence(nmea(padded))


def test_southern_and_western_hemisphere():
    """South and west are negative."""
    reading = decode_sentence(gga(T, at=(-33.8568, -151.2153)))
    assert pytest.approx(-33.8568, abs=1e-8) == reading.latitude_deg
    assert pytest.approx(-151.2153, abs=1e-8) == reading.longitude_deg


@pytest.mark.parametrize("talker", ["GP", "GN", "GL", "GA", "BD", "GB", "GI", "GQ", "QZ", "IN"])
def test_any_talker(talker: str):
    """The talker does not matter."""
    assert "RMC" == decode_sentence(rmc(T, talker=talker)).kind


@pytest.mark.parametrize(
    ("body", "speed"),
    [
        ("GNVTG,,T,,M,10.0,N,,K,A", 10 * 1852 / 3600),
        ("GNVTG,,T,,M,,N,36.0,K,A", 10.0),
        ("GNVTG,,T,,M,19.438,N,36.0,K", 10.0),
        ("GNVTG,,T,,M,,N,,K,A", math.nan),
    ],
)
def test_vtg_speed_from_either_unit(body: str, speed: float):
    """VTG's speed comes from km/h, or from knots where that is empty."""
    assert pytest.approx(speed, nan_ok=True) == decode_sentence(nmea(body)).speed_mps


def test_gns_best_mode_counts():
    """Of GNS's letters, one per satellite system, the best solution is the quality."""
    body = "GNGNS,164144.30,4025.5946957,N,07953.3761472,W,ARN,12,0.55,228.368,-33.0,,"
    reading = decode_sentence(nmea(body))
    assert (4, True, 0.55) == (reading.quality, reading.valid, reading.hdop)
    assert pytest.approx(195.368) == reading.altitude_m


def test_gll():
    """GLL gives position, time and validity."""
    reading = decode_sentence(nmea("GPGLL,4916.45,N,12311.12,W,225444,A,D"))
    assert pytest.approx(49 + 16.45 / 60) == reading.latitude_deg
    assert (2, True) == (reading.quality, reading.valid)
    assert decode_sentence(nmea("GPGLL,4916.45,N,12311.12,W,225444,V")).valid is False


def test_gst_is_rms_of_both_axes():
    """GST's standard deviation per axis is the root mean square of latitude's and longitude's."""
    reading = decode_sentence(nmea("GNGST,164144.3,1,2,1,45,0.3,0.4,0.9"))
    assert pytest.approx(math.sqrt((0.09 + 0.16) / 2)) == reading.position_std_m


def test_missing_fields_are_nan():
    """Empty fields are NaN, and spoil nothing else."""
    reading = decode_sentence(nmea("GNRMC,,A,,,,,12.0,,,,,A"))
    assert pytest.approx(12.0 * 1852 / 3600) == reading.speed_mps
    unknown = (reading.time_of_day_s, reading.latitude_deg, reading.longitude_deg, reading.course_rad)
    assert all(math.isnan(value) for value in unknown)
    assert reading.unix_day is None


def test_second_60():
    """A leap second is a time of day beyond 86400."""
    assert 86400.5 == decode_sentence(nmea("GNRMC,235960.50,A,,,,,,,311216,,,A")).time_of_day_s


@pytest.mark.parametrize(
    ("text", "day"),
    [("060180", 3657), ("311299", 10956), ("010100", 10957), ("110724", 19915), ("310224", None)],
)
def test_two_digit_years(text: str, day: int | None):
    """Years 80 to 99 are last century's; a date that does not exist is none."""
    assert day == decode_sentence(nmea(f"GNRMC,120000,A,,,,,,,{text},,,A")).unix_day


@pytest.mark.parametrize(
    "position", ["9100.0,N,01100.0,E", "4860.0,N,01100.0,E", "4800.0,N,18100.0,E", "4800.0,N,18000.1,W"]
)
def test_impossible_position(position: str):
    """A position outside the earth is left out, and said so."""
    reading = decode_sentence(nmea(f"GNGGA,120000,{position},1,12,0.9,500,M,47,M,,"))
    assert math.isnan(reading.latitude_deg)
    assert reading.out_of_range.startswith("position ")


def test_impossible_speed():
    """A speed beyond 150 m/s is left out, and said so."""
    reading = decode_sentence(vtg(151.0))
    assert math.isnan(reading.speed_mps)
    assert "speed 151.0 m/s" == reading.out_of_range


@pytest.mark.parametrize("mode", ["A", "D", "R", "F", "E", "P"])
def test_rmc_modes_that_measure(mode: str):
    """Every mode with a measured position is valid."""
    assert decode_sentence(rmc(T, mode=mode)).valid is True


@pytest.mark.parametrize(("status", "mode"), [("V", "A"), ("A", "N"), ("V", "N"), ("A", "M"), ("", "A")])
def test_rmc_without_solution(status: str, mode: str):
    """Status V, mode N and a position typed in by hand are no solution."""
    assert decode_sentence(rmc(T, status=status, mode=mode)).valid is False


def test_wrong_checksum():
    """One flipped bit is a checksum error that names both sums."""
    with pytest.raises(SentenceError, match="checksum: GNRMC says 55, its bytes give 54") as caught:
        decode_sentence(b"$GNRMC,161448.298,A,3743.2598620,N,12228.3383180,W,15.2067,2.14,020818,,,A*55")
    assert "checksum" == caught.value.kind


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"$",
        b"GNRMC,no dollar*00",
        b"$GNRMC,\xff*00",
        b"$GNRMC,1*5",
        b"$GNRMC,1*",
        b"$GNRMC,1*ZZ",
        b"$GNRMC,161448.299,A,3743.2598",
        b"$gnrmc,161448*00",
    ],
)
def test_garbage(line: bytes):
    """What is no sentence, or one cut short that has no checksum to show it, is garbage."""
    with pytest.raises(SentenceError) as caught:
        decode_sentence(line)
    assert "garbage" == caught.value.kind


def test_no_checksum_is_accepted():
    """A complete sentence without a checksum is taken, and says that it has none."""
    reading = decode_sentence(rmc(T).split(b"*")[0])
    assert (False, True) == (reading.checksummed, reading.valid)


@pytest.mark.parametrize(
    "body", ["PUBX,00,1,2", "GNGSA,A,3,1,2,3", "GPGSV,1,1,00", "GPXYZ,1", "PGRME,15.0,M"]
)
def test_other_sentences_are_distinguished(body: str):
    """Sentences that nothing is taken from are neither readings nor faults."""
    assert NmeaReading("other", proprietary=body.startswith("P")) == decode_sentence(nmea(body))


FIELDS = st.one_of(
    st.sampled_from(
        ["", "A", "V", "N", "0", "-1", "235960", "4807.038", "01131.0", "1e5", "nan", "99", "999999"]
    ),
    st.text(alphabet=st.characters(codec="ascii", exclude_characters="*$,"), max_size=12),
)


@settings(derandomize=True, deadline=None, max_examples=400)
@given(
    st.sampled_from(["RMC", "GGA", "VTG", "ZDA", "GST", "GNS", "GLL", "GSV"]), st.lists(FIELDS, max_size=16)
)
def test_any_fields(kind: str, fields: list[str]):
    """Any fields under a right checksum give sane values or are garbage."""
    try:
        reading = decode_sentence(nmea(f"GN{kind},{','.join(fields)}"))
    except SentenceError as error:
        assert "garbage" == error.kind
        return
    assert not abs(reading.latitude_deg) > 90.0
    assert not abs(reading.longitude_deg) > 180.0
    assert math.isnan(reading.latitude_deg) == math.isnan(reading.longitude_deg)
    assert math.isnan(reading.speed_mps) or 0.0 <= reading.speed_mps <= 150.0
    assert math.isnan(reading.course_rad) or 0.0 <= reading.course_rad < 2 * math.pi
    assert math.isnan(reading.time_of_day_s) or 0.0 <= reading.time_of_day_s < 86401.0


@settings(derandomize=True, deadline=None, max_examples=400)
@given(st.binary(max_size=60))
def test_any_bytes(line: bytes):
    """Any bytes are a reading or a `SentenceError`, nothing else."""
    for candidate in (line, b"$GNRMC," + line, b"$GNGGA," + line + b"*00"):
        try:
            decode_sentence(candidate)
        except SentenceError as error:
            assert error.kind in ("checksum", "garbage")


@settings(derandomize=True, deadline=None)
@given(st.binary(max_size=300))
def test_a_checksum_is_the_exclusive_or_of_all_bytes(data: bytes) -> None:
    """However many bytes there are, the folded number is what byte by byte would give."""
    assert reduce(xor, data, 0) == exclusive_or(data)


PYNMEA2_NAMES = {
    "satellites": "num_sats",
    "quality": "gps_qual",
    "altitude_m": "altitude",
    "geoid_separation_m": "geo_sep",
    "speed_kn": ("spd_over_grnd", "spd_over_grnd_kts"),
    "speed_kmh": "spd_over_grnd_kmph",
    "course_deg": ("true_course", "true_track"),
    "date": "datestamp",
    "mode": ("mode_indicator", "faa_mode"),
    "hdop": ("horizontal_dil", "hdop"),
    "latitude_std_m": "std_dev_latitude",
    "longitude_std_m": "std_dev_longitude",
    "major_std_m": "std_dev_major",
    "minor_std_m": "std_dev_minor",
}


@pytest.mark.parametrize("kind", sorted(COLUMNS))
def test_columns_are_those_of_another_library(kind: str) -> None:
    """Each field that is read stands in the column in which pynmea2 has it."""
    theirs = pynmea2.TalkerSentence.sentence_types[kind].name_to_idx
    compared = 0
    for name, column in COLUMNS[kind].items():
        names = PYNMEA2_NAMES.get(name, name)
        known = [one for one in ((names,) if isinstance(names, str) else names) if one in theirs]
        if known:
            assert theirs[known[0]] == column, name
            compared += 1
    assert compared >= 4
