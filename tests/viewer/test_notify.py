"""Messages to the user, and warnings of other threads."""

import math
import threading
import warnings

from volspec.errors import VolspecWarning
from volspec.viewer.work.notify import MAX_MESSAGES, Notice, collect_warnings


def test_an_error_is_shown_until_it_is_dismissed_or_replaced():
    notice = Notice()
    notice.show("Saved a.png")
    until = notice.until
    assert not notice.expire(until) and notice.expire(until + 0.1) and not notice.text
    notice.show("b.nrrd: damaged; copy it again", kind="error")
    assert notice.until == math.inf and not notice.expire(2 * until)
    notice.hide("another message")
    assert notice.text.startswith("b.nrrd")
    notice.hide()
    assert notice.current is None
    assert [message.kind for message in notice.messages] == ["info", "error"]


def test_messages_are_listed_once_in_a_row_and_not_without_limit():
    notice = Notice()
    for _ in range(3):
        notice.show_warning("computing\nits table")
    (message,) = notice.messages
    assert (message.text, message.count) == ("computing its table", 3)
    for number in range(2 * MAX_MESSAGES):
        notice.show(str(number))
    assert len(notice.messages) == MAX_MESSAGES
    assert notice.messages[-1].text == str(2 * MAX_MESSAGES - 1)
    notice.clear()
    assert notice.messages == () and not notice.text


def test_a_warning_comes_once_for_each_file_that_is_opened(monkeypatch):
    """Python shows a warning once in a process; an orbit would repeat that of an empty picture."""

    printed: list[str] = []
    monkeypatch.setattr(warnings, "showwarning", lambda message, *_: printed.append(str(message)))

    def warn() -> None:
        warnings.warn("a.npy: 1 of 8 voxels is NaN", VolspecWarning, stacklevel=1)

    with collect_warnings() as queue:
        for opened in range(2):
            for _ in range(3):
                thread = threading.Thread(target=warn)
                thread.start()
                thread.join()
            assert queue.take() == ["a.npy: 1 of 8 voxels is NaN"], opened
            assert len(printed) == opened + 1
            queue.forget()
