"""How much of a model a scene needs: fidelity levels compared, and the cheapest that suffices."""
