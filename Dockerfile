# xfrustum in a container, set up as README says, "Other systems".
#   docker build -t xfrustum .
#   docker run --rm -v "$PWD:/data" xfrustum report car --out report
FROM debian:bookworm-slim

# make is all that `make setup` needs of a bare system: as root it installs the rest itself.
RUN apt-get update && apt-get install -y --no-install-recommends make ca-certificates

WORKDIR /xfrustum
COPY . .
RUN make setup

ENV PATH=/xfrustum/.venv/bin:$PATH
WORKDIR /data
ENTRYPOINT ["xfrustum"]
CMD ["--help"]
