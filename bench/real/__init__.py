"""`cellwatt explain` on recordings of real arms, whose owners know what was left out; the tool is not told.

The recordings stay where they are (``../shared/data`` beside the checkout); only derived figures leave here.

    recording, ur10e, panda, kuka,
    kr300                            a source's files as tables that the product reads
    describe                         robot.yaml and URDF in a work folder
    identify, calibrate              the owner's preparation: link parameters, friction and drive gains by least squares
    product                          the commands, run as processes
    stories                          one function an experiment, from files to figures
"""
