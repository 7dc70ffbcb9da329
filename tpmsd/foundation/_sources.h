/* What tells of which sources a compiled part was built: the number that `kernels.sources_number` gives them, as
 * `SOURCES` of the module. setup.py hands it over. Included after `Py_LIMITED_API`.
 */
#ifndef TPMSD_SOURCES_H
#define TPMSD_SOURCES_H
#include <Python.h>

static int add_sources(PyObject *module)
{
    return PyModule_AddIntConstant(module, "SOURCES", TPMSD_SOURCES);
}

static PyModuleDef_Slot slots[] = {{Py_mod_exec, add_sources}, {0, NULL}};

#endif
