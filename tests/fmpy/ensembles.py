"""Studies that tests and benches/ensembles make twice, on a device of OpenCL and on the processor."""

# A loop, what varies, the metric of the requirement, and further options: noise that is sampled, limits, and an event among them.
STUDIES = {
    "plain": ("3.2.1-cosine", ["plant.omega=±30%", "adaptation_gain=1e4..1e5/log"], "max |u|", ["--until", "2"]),
    "an event": (
        "3.2.1-cosine",
        ["plant.omega=±30%", "event[1].time=0.2..0.8"],
        "max |u|",
        ["--until", "1", "--event", "0.5: reference.offset[1]=0.5"],
    ),
    "noise": ("3.3.1-case2-bench", ["plant.m1=±10%"], "max", ["--until", "0.2"]),
    "limits": ("3.3.2-case1-rotors", ["plant.g=±5%"], "max", ["--until", "1"]),
    "a fuzzy law": ("4-case1-fuzzy", ["plant.C[1,1]=±20%"], "max", ["--until", "0.1"]),
}
