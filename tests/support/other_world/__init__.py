"""A second world to look at: films of a ball on a tilting plate, ray cast in linear light.

Shares no code with `vision` (nor with its synthetic camera, nor with the benchmark's scenes), so a
threshold that fits those renderers alone is found out. `rays` casts, `scene` draws a film at random
from a seed.
"""
