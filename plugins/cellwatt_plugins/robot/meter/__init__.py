"""A power meter as it is: its values are means over a time, come late, and are held until the next.

Whatever is compared with measured power is first put through the meter: averaged over the same times.
"""
