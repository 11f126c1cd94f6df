import math

import pytest

from analysis.pages.formats import exact, fit_percent, known_exactly, printed, readable, shown, without_exponents


@pytest.mark.parametrize(
    ("value", "like", "std", "text"),
    [
        (2.0932, 2.09, 0.015, "2.093"),
        (95.165, 99.69, 0.57, "95.17"),
        (0.1489347, 0.116, None, "0.1489"),
        (327.2, 320.0, None, "327"),
        (-29.855, 29.0, None, "−29.9"),
        (0.00034, None, None, "0.0003400"),
        (2.77e27, None, None, "2.770·10²⁷"),
        (7.8123e-9, 7.28999e-9, 7.2e-10, "7.81·10⁻⁹"),
        (0.0, 1.0, None, "0"),
        (None, 1.0, None, "—"),
        (math.nan, 1.0, None, "—"),
        (math.inf, 1.0, None, "never"),
    ],
)
def test_as_many_digits_as_are_known(value, like, std, text):
    assert shown(value, like=like, std=std) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(2.77e27, "2.77·10²⁷"), (1e8, "1·10⁸"), (0.05, "0.05"), (1750.7, "1750.7"), (-8.5, "−8.5"), (None, "—")],
)
def test_printed_numbers_keep_their_digits(value, text):
    assert exact(value) == text


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (3.3e4, 2, "33,000"),
        (123456.0, 3, "123,000"),
        (3.3e7, 2, "3.3·10⁷"),
        (-2.1e-5, 2, "−2.1·10⁻⁵"),
        (0.0, 3, "0"),
        (12.345, 3, "12.3"),
        (999.96, 3, "1,000"),
    ],
)
def test_a_number_for_people_has_no_exponent(value, digits, text):
    assert readable(value, digits) == text


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (0.127, "87.3 %"),
        (1.73e-4, "99.983 %"),
        (1.2e-5, "99.9988 %"),
        (2.48e-8, "above 99.999 %"),
        (0.0, "100.0 %"),
        (1.34, "no fit"),
        (0.999, "0.1 %"),
        (math.nan, "—"),
    ],
)
def test_a_fit_has_two_digits_of_what_is_missing(error, text):
    assert fit_percent(error) == text


def test_a_text_loses_its_exponents_and_a_name_keeps_them():
    assert without_exponents("off by 3.3e+04 (p = 2e-09), see run-1e-5.h5 and 1e5.csv") == (
        "off by 33,000 (p = 2·10⁻⁹), see run-1e-5.h5 and 1e5.csv"
    )


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("at most 1+4.6e-05 at 2434 Hz", "at most 1+4.6·10⁻⁵ at 2434 Hz"),
        ("1.39e+09", "1.39·10⁹"),
        ("0.2 (+2.67e+09 %)", "0.2 (+2.67·10⁹ %)"),
        ("-0.5 to 0.5, theta_x (-3.189e-05)", "−0.5 to 0.5, θx (−3.189·10⁻⁵)"),
        ("run 12e45678, /data/1e-05/run-2e-3.h5, 2026-11-28", "run 12e45678, /data/1e-05/run-2e-3.h5, 2026-11-28"),
        ("1e+999", "1e+999"),
    ],
)
def test_a_page_prints_numbers_and_axes_as_a_reader_knows_them(text, shown):
    assert printed(text) == shown


def test_a_number_that_is_known_exactly_has_no_error_worth_printing():
    assert known_exactly(2.5724e-7, 1.3e-22) and known_exactly(-3.0, 1e-9)
    assert not known_exactly(3.0, 1e-5) and not known_exactly(3.0, None) and not known_exactly(0.0, 0.0)
