"""The cell as an OPC UA server, with the types of OPC 40010-1 (Robotics). Needs the extra ``opc-ua``.

outlet      settings, and tells the process that serves what the cell says
serving     that process: the server and its nodes
robotics    the standard's types, and the arms of the cell as instances of them
bounds      what clients may ask, announced and enforced
arrays      those that are longer than any request may be
conditions  alarms as conditions, to be acknowledged
"""
