"""The cell as an OPC UA server, with the types of OPC 40010-1 (Robotics). Needs the extra ``opc-ua``.

settings    address, certificates and users
sink        starts the process that serves, tells it what the cell says, and does what people acknowledge
process     that process: begun with a socket to it
serving     its inside: what it is told, in order
served      the server and its nodes
robotics    the standard's types, and the arms of the cell as instances of them
conditions  alarms as conditions, to be acknowledged
"""
