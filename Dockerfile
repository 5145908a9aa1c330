# Both programs in a container, by the locked versions: docs/how-to/install.md says what works in one.
FROM python:3.13-slim AS build
WORKDIR /build
COPY .ci/uv.txt .ci/uv.txt
RUN pip install --no-cache-dir --require-hashes -r .ci/uv.txt
COPY pyproject.toml uv.lock README.md LICENSE ./
COPY links links
COPY groundstation groundstation
COPY sim sim
# Compiled, as whoever runs it may not write beside the modules, and each start would compile them anew.
RUN UV_PROJECT_ENVIRONMENT=/usr/local/groundstation uv sync --frozen --no-default-groups --no-editable --no-cache \
    --compile-bytecode

FROM python:3.13-slim
COPY --from=build /usr/local/groundstation /usr/local/groundstation
ENV PATH=/usr/local/groundstation/bin:$PATH
RUN useradd --create-home pilot && install --directory --owner pilot /flights
USER pilot
WORKDIR /flights
CMD ["groundstation-sim", "fly"]
