"""The loop closed: a user's MJCF, a plant that has more physics than it, and the file that comes back mended.

The arms, their concealed effects, controllers and sensors are those of the blind benchmark (`concealed`), which shares
nothing with the product; the product runs as a process on files.

    arms      which effects which arm has; the user's MJCF, with frames of its own
    judge     a file on motion that nobody was shown, by plain MuJoCo
    peer      the same recordings to `mujoco.sysid`
    numbers   how far the joints' numbers of a file are from the truth
    runner, page, picture
"""
