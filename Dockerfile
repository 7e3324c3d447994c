# Image with the programs `phalanx` and `phalanx-bench`, the manual pages and the shipped scenarios. Runs and tests in it need only
# Docker's default of 64 MB of shared memory.
#
#   docker build -t phalanx .
#   docker run --rm -v "$PWD/runs:/phalanx/runs" phalanx run scenarios/triangle.toml

FROM rust:1.89-bookworm AS build
WORKDIR /phalanx
COPY . .
RUN cargo build --profile dist --locked -p phalanx -p bench
RUN cargo run --profile dist --locked --features manual --bin phalanx-manual -- target/manual

# docker build --target test .
FROM build AS test
RUN cargo test --workspace --locked

FROM debian:bookworm-slim
COPY --from=build /phalanx/target/dist/phalanx /phalanx/target/dist/phalanx-agent \
    /phalanx/target/dist/phalanx-bench /usr/local/bin/
COPY --from=build /phalanx/target/manual/man1 /usr/local/share/man/man1
COPY LICENSE-APACHE LICENSE-MIT /usr/local/share/doc/phalanx/
WORKDIR /phalanx
COPY scenarios scenarios
ENTRYPOINT ["phalanx"]
CMD ["--help"]
