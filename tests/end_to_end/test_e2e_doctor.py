"""The first thing to try when something is amiss."""

from __future__ import annotations

from processes import Folder


def test_the_doctor_finds_this_machine_fit(folder: Folder):
    result = folder.mvtn("doctor", "--json")
    document = result.document
    assert result.code == 0 and document["ok"] is True
    assert {check["state"] for check in document["checks"]} <= {"ok", "warn"}
    assert all(check["fix"] for check in document["checks"] if check["state"] == "warn")
    assert not any(folder.path.glob("[!m]*")) and not folder.cache.exists()  # it only looks
