"""Outlets beside the plain libraries of the same protocols, and a whole daemon whose servers hang.

rows         frames of 60 channels, and as much of a cell as an outlet needs
loop         an outlet that runs beside other work, and how late its event loop is
turns        runs of several ways, one after the other
children     processes of the benchmark, spoken to in lines of JSON
servers      Mosquitto, InfluxDB, and one that takes connections and says nothing
mqtt         rows to a broker (with ``mqtt_plain``, the client alone, and ``mqtt_reader``, who counts)
metrics      the endpoint for Prometheus
historian    InfluxDB and a lake of Parquet files (with ``influx``)
opc_ua       a server of 60 variables (with ``opc_ua_plain``, the library alone, and ``opc_ua_reader``, who counts)
blocked      a daemon without outlets, with outlets whose servers hang, and with servers that answer
page         tables
"""
