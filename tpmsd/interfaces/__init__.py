"""Interfaces: what people and programs touch. The topmost layer: it may import all others, none imports it.

In: the command line, a notebook, a browser, a broker. Out: text, JSON, pages, messages.
`cli` is a module per command, `api` the functions behind `import tpmsd`, `web` the pages of `tpmsd web`, and
`bridges` the processes that carry the daemon's status to MQTT, Prometheus, D-Bus and VSS.

To be changed here: options, help, wording of commands, pages, messages. A command parses, calls one
function of the layers below and prints; what is computed, is computed there.
"""
