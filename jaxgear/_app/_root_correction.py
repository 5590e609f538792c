"""stub"""
def root_correction(body, pair, index, grid, *, points):
    return None
