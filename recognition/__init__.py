"""Pure recognition: invariants, pose, model base, detectors, belief, policies and the loop."""
