"""Bridges to other systems: programs of their own, beside the daemon, that read its status socket.

In: status documents. Out: MQTT, Prometheus. The daemon neither knows nor waits for them.
"""
