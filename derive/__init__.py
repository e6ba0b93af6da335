"""From a scene to the text of its module: the build-time half of kaneflex, and the only importer of SymPy.

Import its modules, not names of the package: the printer of C needs no SymPy. One structure takes this path:

    equations   structure of a scene -> symbolic mechanism -> Kane's equations -> rigid motion as assignments
    elements    Kane's equations of a slice of a beam -> affine form of an element -> kernels of an element
    ir          Program: scalar assignments; common subexpressions, pruning, operation counts
    printers    Program -> numba function; numba function -> C; Program -> LaTeX; tables and frame of a module
    generate    generate(scene) -> text of the module of the scene's structure; latex: the same as a document

Modules that all structures share are printed once. Each has one function that returns its text:

    elements.plane, elements.space       kernels of one beam element, for each theory
    bodies.kernels                       kernels of bodies that deform by shapes; their proof
    laws.joints                          rigid bodies, joints and springs
    laws.contact, laws.friction          contacts and dry friction
    printers.functions_text, rows        functions that kernels call; rows of modules' tables

laws.drives_and_loads prints drives and loads of one structure for the multibody engine. ``python -m kaneflex.derive``
writes all of ``generated/``.
"""

if __name__ == "derive":
    raise ImportError("import kaneflex.derive, not derive: under two names it would be loaded twice")
