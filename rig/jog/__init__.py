"""Moving and looking by hand: the full-screen terminal of ``rig jog``, and the preview page beside it.

`rig.jog.jogger` commands the guard and knows nothing of the screen; `rig.jog.app` is the screen, and needs textual.
"""
