"""Makes motor.csv: a DC motor with Coulomb friction, driven by levels of its voltage, as a bench records it.

python examples/records/motor.py > examples/records/motor.csv
"""

import random

STEP, ROWS, WITHIN = 0.002, 900, 20
K, R, L, J, B, FRICTION = 0.05, 1.2, 0.012, 4e-4, 2e-4, 2e-3  # N·m/A, Ω, H, kg·m², N·m·s, N·m

random.seed(7)
speed = current = voltage = 0.0
left = 0
print("time,voltage [V],speed [rad/s],current [A]")
for row in range(ROWS):
    if left == 0:
        voltage, left = round(random.uniform(-10, 10), 1), random.randint(8, 70)
    left -= 1
    measured = speed + random.gauss(0, 0.3), current + random.gauss(0, 0.02)
    print(f"{row * STEP:g},{voltage:g},{measured[0]:.2f},{measured[1]:.3f}")
    for _ in range(WITHIN):
        torque = K * current - B * speed
        # What is smaller than the friction at rest moves nothing.
        friction = max(-FRICTION, min(FRICTION, torque)) if abs(speed) < 1e-3 else FRICTION * (1 if speed > 0 else -1)
        speed += STEP / WITHIN * (torque - friction) / J
        current += STEP / WITHIN * (voltage - R * current - K * speed) / L
