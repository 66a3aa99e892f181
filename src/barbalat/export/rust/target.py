"""``--target rust``: a crate around the exported C, without dependencies."""

from __future__ import annotations

from barbalat.export.target import Request, Target


def _files(asked: Request) -> dict[str, str]:
    from barbalat.export.rust.files import files

    return files(asked)


TARGETS = (
    Target(
        name="rust",
        help="a Rust crate with a safe wrapper around the C",
        files=_files,
        parameters=True,
        check=lambda folder, _: f"cd {folder} && cargo test --offline",
    ),
)
