"""What a person does in the first minutes after `pip install`: a closed loop, a plot, a tuned gain, an FMU for six platforms.

    python from_nothing.py FOLDER

Needs Python, this package with its extras `plot` and `compile`, and nothing else: no Rust, no C compiler, no repository.
"""

import sys
from pathlib import Path

import adaptive_fmu

PLATFORMS = ["linux64", "linux32", "aarch64-linux", "win64", "darwin64", "aarch64-darwin"]

folder = Path(sys.argv[1])
loop = adaptive_fmu.Loop("3.2.1-cosine")
result = loop.run().check()
result.plot().savefig(folder / "loop.png")
tuned = loop.tune({"controller.feedback_gain[1,1]": (5.0, 40.0)}, metric="max |u|", until=6, particles=4, generations=2)
[fmu] = adaptive_fmu.export("L1NonlinearSiso", out=folder, platforms=PLATFORMS)
print(result, tuned, fmu, sep="\n")
