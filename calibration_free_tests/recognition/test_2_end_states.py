"""How recognitions end."""
