"""The cell as an OPC UA server, with the types of OPC 40010-1 (Robotics). Needs the extra ``opc-ua``.

outlet      settings; sends the cell's data to the serving process
serving     the serving process: the server and its nodes
robotics    the standard's types, and the arms of the cell as instances of them
access      users, and certificates of clients
bounds      limits of client requests, announced and enforced
arrays      limit of the length of arrays in requests
conditions  alarms as conditions that clients acknowledge
"""
