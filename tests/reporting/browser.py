"""A page opened in a headless browser, with a script of the test's own in it."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="needs a browser: chromium or google-chrome on the PATH")

FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--enable-logging=stderr",
    "--virtual-time-budget=3000", "--window-size=1000,800", "--dump-dom",
]  # fmt: skip


def try_page(text: str, script: str, folder: Path, *flags: str) -> tuple[dict[str, Any], list[str]]:
    """What a script that writes JSON into `<pre id="found">` found on a page, and the lines of its console."""
    page = folder / "tried.html"
    page.write_text(text.replace("</body>", f"<script>{script}</script></body>"))
    command = [str(BROWSER), *FLAGS, *flags, f"--user-data-dir={folder / 'profile'}", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    result = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert result is not None, (console, done.stderr[-2000:])
    return json.loads(html.unescape(result[1])), console
