"""A third world to look at: films of MuJoCo's OpenGL renderer (a graphics card or Mesa's EGL).

Shares no code with `vision`, nor with its synthetic camera, nor with `tests.support.other_world`:
meshes, shadow maps and Phong shading that mix grey levels, textures of text and grain, a ball that
rolls by its own physics. `plan` draws a film from a seed, `scene` writes it as a model, `motion`
moves plate, ball and hand, `film` takes the pictures and knows where the ball was.
"""
