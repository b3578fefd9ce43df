"""`mvtn doctor`: what this machine can do, what not, and the fix; of a data set see `dataset_doctor.py`."""

from __future__ import annotations

import os
import platform
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import Any, Literal

from mvtn_cli import __version__
from mvtn_cli.commands.cache import size_words
from mvtn_cli.commands.options import Call
from mvtn_cli.config import DoctorConfig
from mvtn_cli.console import counted
from mvtn_cli.errors import MvtnError

NEEDED = {  # import name: distribution
    "torch": "torch",
    "torchvision": "torchvision",
    "lightning_fabric": "lightning-fabric",
    "numba": "numba",
    "numpy": "numpy",
    "scipy": "scipy",
    "sklearn": "scikit-learn",
    "trimesh": "trimesh",
    "fast_simplification": "fast-simplification",
    "h5py": "h5py",
    "safetensors": "safetensors",
    "matplotlib": "matplotlib",
    "jinja2": "jinja2",
    "PIL": "pillow",
    "psutil": "psutil",
}
LOW_DISK = LOW_MEMORY = 2_000_000_000  # bytes


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's report."""

    name: str
    state: Literal["ok", "warn", "bad"]
    detail: str
    fix: str = ""


def doctor(config: DoctorConfig, call: Call) -> None:
    """Look at Python, packages, devices, threads, back ends, cache, weights, disk and terminal; or at a data set.

    Exits with 1 if something is broken that mvtn needs, or if something in the data set would spoil a benchmark.

    Example: mvtn doctor modelnet40:ModelNet40
    """
    if config.data is not None:
        from mvtn_cli.commands.dataset_doctor import examine_dataset

        return examine_dataset(config.data, config.workers, call)
    findings: list[Finding] = []
    for check in CHECKS:
        for finding in _safely(check, config, call):
            findings.append(finding)
            fix = f"  ({finding.fix})" if finding.fix else ""
            call.console.record(asdict(finding), f"{finding.state:<4}  {finding.name}: {finding.detail}{fix}")
    bad = [finding.name for finding in findings if finding.state == "bad"]
    call.console.result({"schema": "mvtn.doctor/1", "ok": not bad}, records="checks")
    if bad:
        raise MvtnError(f"broken: {', '.join(bad)}", hint="the lines marked bad say how to mend it", code="doctor.bad")
    warnings = sum(finding.state == "warn" for finding in findings)
    call.console.note(f"all that is needed works, {counted(warnings, 'warning')}; next: mvtn preprocess && mvtn train")
    return None


def _safely(
    check: Callable[[DoctorConfig, Call], Iterator[Finding]], config: DoctorConfig, call: Call
) -> Iterator[Finding]:
    """A doctor must not faint: whatever a check runs into is a finding."""
    try:
        yield from check(config, call)
    except Exception as error:
        name = check.__name__.strip("_").replace("_", " ")
        yield Finding(name, "bad", f"{type(error).__name__}: {error}", "run again with --debug")


def _python(config: DoctorConfig, call: Call) -> Iterator[Finding]:
    version = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    yield Finding("python", "ok", version)
    yield Finding("mvtn", "ok", __version__)


def _packages(config: DoctorConfig, call: Call) -> Iterator[Finding]:
    for module, distribution in NEEDED.items():
        try:
            import_module(module)
            yield Finding(distribution, "ok", metadata.version(distribution))
        except Exception as error:  # a broken wheel raises anything
            words = " ".join(str(error).split())[:200]
            yield Finding(distribution, "bad", words, f"pip install --force-reinstall {distribution}")


def _devices(config: DoctorConfig, call: Call) -> Iterator[Finding]:
    import torch

    if torch.cuda.is_available():
        names = [torch.cuda.get_device_name(index) for index in range(torch.cuda.device_count())]
        yield Finding("cuda", "ok", ", ".join(names))
    else:
        built = torch.version.cuda
        reason = f"torch is built for CUDA {built} but sees no device" if built else "this torch is built without"
        yield Finding("cuda", "ok", f"none: {reason}; networks run on the CPU")
    if torch.backends.mps.is_available():
        yield Finding("mps", "ok", "available: --device mps")


def _threads(config: DoctorConfig, call: Call) -> Iterator[Finding]:
    import numba
    import torch

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    threads, kernels = torch.get_num_threads(), numba.get_num_threads()
    detail = f"{cores} cores; networks use {threads}, renderer {kernels}"
    few = min(threads, kernels) < cores
    fix = "unset OMP_NUM_THREADS and NUMBA_NUM_THREADS, or give --threads" if few else ""
    yield Finding("threads", "warn" if few else "ok", detail, fix)


def _memory(config: DoctorConfig, call: Call) -> Iterator[Finding]:
    import psutil
    import torch

    from mvtn_cli.core.training.device import memory_of

    allowed = memory_of(torch.device("cpu"))
    free = min(allowed, psutil.virtual_memory().available)
    low = free < LOW_MEMORY
    fix = "stop other programs, or train with a small --batch-size" if low else ""
    yield Finding("memory", "warn" if low else "ok", f"{size_words(allowed)}, {size_words(free)} free", fix)


def _renderer(config: DoctorConfig, call: Call) -> Iterator[Finding]:
    import numba

    @numba.njit
    def add(a: float, b: float) -> float:
        return a + b

    works = add(1.0, 2.0) == 3.0
    detail = "numba kernels on the CPU" if works else "numba compiles wrongly"
    yield Finding("renderer", "ok" if works else "bad", detail, "" if works else "reinstall numba")
    import torch

    if torch.cuda.is_available():
        from mvtn_cli.core.render.devices import missing_for_cuda

        missing = missing_for_cuda()
        where = f"drawn on the CPU and copied: {missing}" if missing else "numba-cuda kernels"
        yield Finding("renderer on cuda", "warn" if missing else "ok", where)


def _cache(config: DoctorConfig, call: Call) -> Iterator[Finding]:
    from mvtn_cli.core.store import Store, cache_root

    store = Store(cache_root(config.cache))
    if not _writable(store.root):
        yield Finding("cache", "bad", f"{store.root} can't be written", "give --cache DIR, or set MVTN_CACHE")
        return
    total = sum(size.bytes for size in store.sizes().values())
    yield Finding("cache", "ok", f"{store.root}, {size_words(total)}")


def _runs(config: DoctorConfig, call: Call) -> Iterator[Finding]:
    if _writable(config.runs):
        yield Finding("runs", "ok", f"{config.runs.absolute()}")
    else:
        yield Finding("runs", "warn", f"{config.runs.absolute()} can't be written", "give --runs DIR to train")


def _disk(config: DoctorConfig, call: Call) -> Iterator[Finding]:
    from mvtn_cli.core.store import cache_root

    free = shutil.disk_usage(_existing(cache_root(config.cache))).free
    low = free < LOW_DISK
    fix = "mvtn cache clear, or --cache DIR on another disk" if low else ""
    yield Finding("disk", "warn" if low else "ok", f"{size_words(free)} free for the cache", fix)


def _imagenet_weights(config: DoctorConfig, call: Call) -> Iterator[Finding]:
    import torch

    folder = Path(torch.hub.get_dir()) / "checkpoints"
    found = sorted(path.stem for path in folder.glob("*.pth")) if folder.is_dir() else []
    if found:
        yield Finding("imagenet weights", "ok", f"{', '.join(found)} in {folder}")
        return
    fix = "--weights imagenet downloads them; without internet copy a .pth there, or use --weights PATH"
    yield Finding("imagenet weights", "ok", f"none in {folder}", fix)


def _terminal(config: DoctorConfig, call: Call) -> Iterator[Finding]:
    if not call.console.is_terminal("err"):
        yield Finding("terminal", "ok", "none: progress is a line every 30 s")
        return
    color = "no colour (NO_COLOR)" if os.environ.get("NO_COLOR") else "colour"
    yield Finding("terminal", "ok", f"{shutil.get_terminal_size().columns} columns, {color}")


def _existing(path: Path) -> Path:
    """The nearest folder above that is there."""
    path = path.absolute()
    while not path.exists():
        path = path.parent
    return path


def _writable(path: Path) -> bool:
    return os.access(_existing(path), os.W_OK | os.X_OK)


CHECKS: tuple[Callable[[DoctorConfig, Call], Iterator[Any]], ...] = (
    *(_python, _packages, _devices, _threads, _memory, _renderer),
    *(_cache, _runs, _disk, _imagenet_weights, _terminal),
)
