"""The cell as an OPC UA server. Needs the extra ``opc-ua``.

outlet      settings; sends the cell's data to the serving process
serving     the serving process: the server and its nodes
access      users, and certificates of clients
bounds      limits of client requests, announced and enforced
arrays      limit of the length of arrays in requests
conditions  alarms as conditions that clients acknowledge
"""
