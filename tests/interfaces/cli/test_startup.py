"""What commands do not import: they start quickly, and the daemon stays small."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

CHECKED = """
import sys
from tpmsd.interfaces.cli.main import main
main({arguments!r})
print(*sorted(name for name in {names!r} if name in sys.modules))
"""
HEAVY = ["asammdf", "pandas", "scipy", "scipy.stats", "scipy.ndimage"]


def imported(arguments: list[str], names: list[str]) -> str:
    """Which of these modules a command imports; the last line that it prints."""
    code = CHECKED.format(arguments=arguments, names=names)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[-1]


def test_status_imports_no_numpy(tmp_path: Path) -> None:
    """Asking the daemon needs a socket and a table."""
    asked = ["status", "--socket", str(tmp_path / "none.sock")]
    assert "" == imported(asked, [*HEAVY, "numpy", "can", "cantools"])


def test_check_imports_nothing_heavy(tmp_path: Path) -> None:
    """A configuration that is not there is found out about with the modules of one that is."""
    assert "cantools" == imported(["check", str(tmp_path)], [*HEAVY, "cantools"])


def test_the_daemons_core_imports_no_scipy() -> None:
    """The pipeline has the few functions of probability that it needs."""
    code = CHECKED.format(arguments=["--version"], names=HEAVY).replace(
        "print(", "import tpmsd.onboard.pipeline\nprint("
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "" == done.stdout.splitlines()[-1]


@pytest.mark.parametrize(("method", "drawn"), [("gaussian-sum", False), ("mpf-pn", True)])
def test_only_filters_that_draw_import_numpys_generators(method: str, drawn: bool) -> None:
    """The default filter does without, 2 MB less of a daemon."""
    code = f"""
import sys
import numpy as np
from tpmsd.car.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.onboard.estimators.build import build_filter
vehicle = VehicleConfig((0.32,) * 4, 1.5, 1.5, 2.6)
build_filter(vehicle, GnssConfig(), FilterConfig(method={method!r}), lambda: np.random.default_rng(1), True)
print("numpy.random" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert str(drawn) == done.stdout.strip(), done.stderr


def test_replay_imports_no_scipy(tmp_path: Path) -> None:
    """Nor anything of the diagnosis, nor, without a model, any effect."""
    names = [*HEAVY, "tpmsd.offline.diagnosis", "tpmsd.offline.calibration", "tpmsd.car.physics.catalogue"]
    assert "" == imported(["replay", str(tmp_path)], names)


def test_simulate_imports_no_statistics(tmp_path: Path) -> None:
    """A drive is made without the packages of signals and statistics, which take longest to import."""
    arguments = ["simulate", str(tmp_path / "drive"), "--duration", "5"]
    assert "" == imported(arguments, ["scipy.signal", "scipy.stats", "scipy.ndimage", "pandas"])


def test_mf4_is_brought_in_after_all(tmp_path: Path) -> None:
    """A command that left asammdf out reads an MF4 file as if it had not."""
    pytest.importorskip("asammdf")
    code = f"""
from pathlib import Path
from tpmsd.foundation.startup import leave_out_mf4
leave_out_mf4()
import can
assert can.io.mf4.asammdf is None
from tpmsd.foundation.startup import bring_in_mf4
bring_in_mf4()
path = Path({str(tmp_path / "can.mf4")!r})
with can.io.mf4.MF4Writer(path) as writer:
    writer.on_message_received(can.Message(timestamp=1.0, arbitration_id=5, data=b"ab"))
from tpmsd.onboard.sources.can.log import read_can_log
print(len(list(read_can_log(path, lambda line, what: print(what)))))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "1" == done.stdout.strip(), done.stderr


def test_the_daemon_is_imported_without_openssl() -> None:
    """Neither the daemon's hashes, python-can's asyncio nor NumPy's generators bring OpenSSL in; hashes are
    the same, and who wants ssl afterwards has it."""
    pytest.importorskip("ssl")
    code = """
import sys
from tpmsd.foundation.startup import leave_out_mf4, without_openssl
leave_out_mf4()
with without_openssl():
    import tpmsd.onboard.daemon.loop
import hashlib
import numpy.random
print(*("can" in sys.modules, "_ssl" in sys.modules, "_hashlib" in sys.modules))
print(hashlib.sha256(b"").hexdigest()[:8])
import ssl
print(ssl.create_default_context() is not None)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ["True False False", "e3b0c442", "True"] == done.stdout.splitlines(), done.stderr


def test_a_diagnosis_runs_no_module_that_it_has_no_use_for() -> None:
    """Of what cantools and SciPy import whole, modules of which nothing is used do not run; what is asked for
    does."""
    code = """
import sys
from types import ModuleType
from tpmsd.foundation.startup import ON_DEMAND, import_on_demand, leave_out_mf4
leave_out_mf4()
import_on_demand()
import tpmsd.interfaces.cli.drive_reading, tpmsd.offline.diagnosis.diagnose
ran = [name for name in ON_DEMAND if type(sys.modules.get(name)) is ModuleType]
print(*ran, *(name for name in ("can", "pandas") if name in sys.modules))
import numpy as np
print(np.polynomial.Polynomial([1.0, 2.0])(3.0), type(np.polynomial) is ModuleType)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ["", "7.0 True"] == done.stdout.splitlines(), done.stderr


def test_what_is_imported_is_left_out_of_the_collection_of_cycles(tmp_path: Path) -> None:
    """A command's modules are searched for cycles neither while it runs nor when it ends."""
    code = f"""
import atexit, gc
from tpmsd.interfaces.cli.main import main
kept = gc.get_freeze_count()
atexit.register(lambda: print(gc.get_freeze_count() > during))  # the first registered runs last
main(["replay", {str(tmp_path)!r}])
during = gc.get_freeze_count()
print(kept, during > 50_000)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ["0 True", "True"] == done.stdout.splitlines(), done.stderr
