"""A hold begins with a fresh press, lasts for 3 s after the last sign of a hand, and passes on through zero."""

from txt1.control.holding import Hold

LEFT, RIGHT = 1, 2


def test_a_hold_lasts_3_s_after_the_last_sign_and_then_needs_a_fresh_press() -> None:
    hold = Hold()
    assert hold.drives(0.0) is None and not hold.expired, "nobody holds, and nobody has"
    hold.press(LEFT, 1.0)
    hold.sign(LEFT, 2.0)
    assert hold.drives(5.0) == LEFT
    assert hold.drives(5.001) is None and hold.expired
    hold.sign(LEFT, 5.1)
    assert hold.drives(5.1) is None, "a sign begins no hold"
    hold.press(LEFT, 6.0)
    assert hold.drives(6.0) == LEFT and not hold.expired


def test_an_old_sign_and_that_of_another_hand_renew_nothing() -> None:
    hold = Hold()
    hold.press(LEFT, 1.0)
    hold.sign(LEFT, 0.5)
    hold.sign(RIGHT, 3.0)
    assert hold.drives(4.0) == LEFT
    assert hold.drives(4.001) is None


def test_between_two_hands_nobody_drives_for_a_tenth_of_a_second() -> None:
    hold = Hold()
    hold.press(LEFT, -1.0)
    assert hold.drives(-1.0) == LEFT
    hold.press(RIGHT, 0.0)
    assert hold.drives(0.0) is hold.drives(0.099) is None
    assert hold.drives(0.1) == RIGHT


def test_the_hand_that_let_go_drives_at_once_when_it_presses_anew() -> None:
    hold = Hold()
    hold.press(LEFT, 0.0)
    hold.end(1.0)
    assert hold.drives(1.0) is None and not hold.expired
    hold.press(LEFT, 1.02)
    assert hold.drives(1.02) == LEFT
