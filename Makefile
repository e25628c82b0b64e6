# Two commands do everything: `make demo` and `make test`. `make help` lists the rest.
# Set-up starts with any Python from 3.9 on and finds the ones it needs.
ifeq ($(OS),Windows_NT)
PYTHON ?= py
BIN := Scripts/python.exe
else
PYTHON ?= $(shell command -v python3.11 || command -v python3 || echo python3)
BIN := bin/python
endif
VENVS := $(or $(GAUSSIAN_HERITAGE_VENVS),.venv)
ENGINE := $(VENVS)/engine/$(BIN)
BLENDER := $(VENVS)/blender-4.5/$(BIN)
PHOTOS ?=
PROMPTS ?=
PRESET ?= standard
FUZZ_S ?= 600
DRAW ?=
SETS ?=
MONSTREE ?=
RUNS ?=
SYSTEM ?=
PYTHON_VERSION ?=
EXHIBITS := vase;teapot;obelisk;shield;hourglass;mask;goblet;bell;flowerpot;drum
TRAINING_SETS := herz_jesus25,meeting_place9,banana16,sakharov_statue32,skull66,museum_room,store_room,room_6,room_8

.NOTPARALLEL:
.PHONY: help setup demo zip offline-bundle page serve test lint contracts types engine-tests blender-tests web-test window-test container-test windows-test batch-faults kills fuzz hostile lock licences release clean tables test-rooms model-rooms choosing-rooms model-choosing-rooms real-sets mixtures stability bench-training bench-off-path bench-raster bench-gpu bench-blender bench-detail bench-meshes bench-path bench-scale bench-formats readers-test bench-packages bench-serve bench-batch video

help: ## what can be made
	@awk 'BEGIN {FS = ":.*## "} /^##@ / {print "\n" substr($$0, 5)} \
		/^[a-z-]+:.*## / {printf "  %-16s %s\n", $$1, $$2}' $(firstword $(MAKEFILE_LIST))

##@ For users

setup: ## make the environments and fetch the model files; again: nothing to do
	$(PYTHON) scripts/setup_environments.py

demo: setup page ## photos to a Blender scene with separate objects; PHOTOS=folder PROMPTS="a, b" PRESET=preview|standard|best
	$(PYTHON) scripts/demo.py $(if $(PHOTOS),--photos "$(PHOTOS)" --prompts "$(PROMPTS)") --preset $(PRESET)

zip: page ## dist/gaussian_heritage.zip, to be installed in Blender
	$(BLENDER) scripts/build_extension.py

offline-bundle: setup ## dist/gaussian_heritage_offline.zip: sets up the engine without a network; SYSTEM=windows|macos|linux PYTHON_VERSION=3.11
	$(ENGINE) -m engine.install.environment bundle dist/gaussian_heritage_offline$(if $(SYSTEM),_$(SYSTEM)).zip \
		$(if $(SYSTEM),--system $(SYSTEM)) $(if $(PYTHON_VERSION),--python-version $(PYTHON_VERSION))

dist/gaussian_heritage_offline.zip: $(wildcard engine/install/environment/locked-*.txt)
	$(MAKE) offline-bundle

page: setup ## build the web page of the server; again: nothing to do
	$(ENGINE) scripts/build_page.py

serve: page ## the web page: upload photos from a browser; DATA=folder; LAN=1: phones in the same network, signed in by a QR code
	$(ENGINE) -m engine serve --data $(or $(DATA),out/server) $(if $(LAN),--lan --first-user curator)

##@ For developers

test: setup page ## set-up, then all checks and tests, also after one failed; the last lines say what failed
	$(ENGINE) scripts/run_tests.py --make "$(MAKE)" lint contracts engine-tests blender-tests

lint: ## format and lint
	$(ENGINE) -m ruff format --check . || { $(ENGINE) -m ruff check .; exit 1; }
	$(ENGINE) -m ruff check .

contracts: ## import contracts and types
	$(ENGINE) scripts/check_contracts.py

types: ## the types alone
	$(ENGINE) scripts/check_contracts.py types scripts

engine-tests: ## everything that needs no Blender, in two processes
	$(ENGINE) -c "from engine.training import compile_kernels; compile_kernels()" # or both processes compile the same
	$(ENGINE) -m pytest -q -n 2 -m "not gpu and not web and not faults" --ignore=tests/blender tests

blender-tests: ## the add-on in each Blender at hand, against the installed zip
	$(ENGINE) scripts/run_blender_tests.py

web-test: page ## the page in Chromium, on desktop and phone; writes docs/pictures/web; 10 minutes
	GAUSSIAN_HERITAGE_WEB_PICTURES=docs/pictures/web $(ENGINE) -m pytest -q tests/web

window-test: setup dist/gaussian_heritage_offline.zip ## the way of a curator in a real Blender window; needs root, debootstrap and 5 GB; 15 minutes
	$(ENGINE) scripts/window_test.py --doc docs/window.md

container-test: ## build the container image and use it; needs root, buildah, debootstrap and 12 GB; 10 minutes
	$(ENGINE) scripts/container_test.py --doc docs/container.md

windows-test: setup page ## the engine on Windows' Python, under Wine; needs root, debootstrap and 16 GB; an hour
	$(ENGINE) scripts/windows_test.py --doc docs/windows.md

batch-faults: setup ## killed workers, lost schedulers, full disks and other faults of a batch; 3 minutes
	$(ENGINE) -m pytest -q tests/engine/workers/batch

kills: setup ## SIGKILL and SIGTERM at 200 random moments, continued; writes docs/security_kills.md; 40 minutes of two free cores
	$(ENGINE) -m benchmarks.security.kills --doc docs/security_kills.md

fuzz: setup ## damaged inputs to every reader for FUZZ_S seconds, on Linux; writes docs/security_fuzz.md
	$(ENGINE) -m benchmarks.security.fuzz --seconds $(FUZZ_S) --doc docs/security_fuzz.md

hostile: setup ## hostile projects and .blend files in every command and in Blender; writes docs/security_hostile.md
	$(ENGINE) -m benchmarks.security.hostile --doc docs/security_hostile.md

lock: ## write all locked-*.txt with hashes, in requirements and engine/install/environment; needs uv and the network
	$(PYTHON) scripts/lock_requirements.py

licences: page ## docs/licences.md from the locked files, after `make lock`; needs the network
	$(ENGINE) scripts/licences.py

release: setup page ## dist/release: extension repository, offline bundles, container recipe, SBOM, checksums; 6 GB, from a commit
	$(ENGINE) scripts/make_release.py

clean: ## remove results and caches, keep the environments
	rm -rf out dist build *.egg-info .cache .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis

##@ For measuring: each writes its table into docs

tables: setup ## the other measured tables of docs, each by its own command; GAUSSIAN_HERITAGE_DATA names the photo sets
	$(PYTHON) scripts/make_tables.py

test-rooms: setup ## measure the frozen method in random rooms; DRAW=reason freezes HEAD; 12 minutes per room, resumable
	$(ENGINE) -m benchmarks.rooms run $(if $(DRAW),--draw "$(DRAW)") --doc docs/segmentation.md

model-rooms: setup ## the same method in rooms with 3D models of other people; MODELS=folder of *.sh3f (Debian's sweethome3d-furniture)
	$(ENGINE) -m benchmarks.rooms run --rooms models --models "$(MODELS)" --doc docs/segmentation.md

choosing-rooms: setup ## the same in the choosing rooms alone, then keep them in demo/random_rooms/choosing
	$(ENGINE) -m benchmarks.rooms run $(if $(DRAW),--draw "$(DRAW)") --rooms choosing --doc docs/segmentation.md
	$(ENGINE) -m benchmarks.rooms keep

model-choosing-rooms: setup ## eight choosing rooms with 3D models of other people, rendered and trained in out/rooms; MODELS=folder of *.sh3f; 2 hours
	for n in 1 2 3 4 5 6 7 8; do \
		$(BLENDER) demo/random_rooms/make_photos.py --seed 1234$$n --models "$(MODELS)" --out out/rooms/model_room_$$n && \
		$(ENGINE) -m benchmarks.rooms reconstruct out/rooms/model_room_$$n --out out/rooms/model_room_$$n/project || exit; \
	done

real-sets: setup ## objects of real photos by hand-made masks, clicks, words and without a prompt, into docs/objects.md; GAUSSIAN_HERITAGE_DATA names the photo sets; 40 minutes
	$(ENGINE) -m benchmarks.real_sets --doc docs/objects.md

mixtures: setup ## 300 mixed photo folders with a known truth, into docs/mixtures.md; 7 CPU minutes
	$(ENGINE) -m benchmarks.mixtures --doc docs/mixtures.md

stability: ## float32 against float64 in stiff and extreme cases; writes docs/stability.md
	$(ENGINE) -m engine stability --out docs/stability.md

bench-training: setup ## presets on all photo sets beside gsplat, into docs/error_vs_time.md; resumable; 45 CPU minutes
	$(ENGINE) -m benchmarks.training --sets $(TRAINING_SETS) --doc docs/error_vs_time.md \
		--picture docs/error_vs_time_processor.png

bench-off-path: setup ## presets in views that no photo has, of choosing rooms, into docs/training.md; resumable; 40 CPU minutes
	$(ENGINE) -m benchmarks.training.card prepare-rooms --rooms 3,6,8 --out out/off_path
	$(ENGINE) -m benchmarks.training.card train out/off_path --backend cpu --runs preview,standard --seeds 0,1
	$(ENGINE) -m benchmarks.training.card document out/off_path/results --doc docs/training.md \
		--table "off the path on the processor"

bench-raster: setup ## cost of the rasterizer beside others, into docs/rasterizer_speed.md; about 10 minutes
	$(ENGINE) -m benchmarks.raster --document docs/rasterizer_speed.md

bench-gpu: setup ## cost of the gpu backend beside gsplat, into docs/gpu.md; FUSED_SSIM=folder of its sources; needs a graphics card; 5 minutes
	$(ENGINE) -m benchmarks.gpu start
	$(ENGINE) -m benchmarks.gpu ceilings
	$(ENGINE) -m benchmarks.gpu scene 200000
	$(ENGINE) -m benchmarks.gpu scene 1000000
	$(ENGINE) -m benchmarks.gpu scene 3000000
	$(ENGINE) -m benchmarks.gpu_step 1000000
	$(ENGINE) -m benchmarks.gpu_gsplat_step 1000000 $(if $(FUSED_SSIM),--fused-ssim $(FUSED_SSIM))
	$(ENGINE) -m benchmarks.gpu document --doc docs/gpu.md

bench-blender: setup ## import, redraw, sliders and pictures in Blender, into docs/blender_speed.md; needs `make demo` and what window-test needs; 15 minutes
	$(ENGINE) -m engine reconstruct "$(GAUSSIAN_HERITAGE_DATA)/sakharov_statue32/photos" --out out/sakharov_statue32/project \
		--no-objects --preset preview --until training
	$(ENGINE) -m benchmarks.blender --museum out/museum_room/project --statue out/sakharov_statue32/project \
		--doc docs/blender_speed.md

bench-detail: setup ## detail of objects at the photos' own size, into docs/detail.md; needs `make demo`; MONSTREE=folder of its photos; resumable; 3 hours
	$(BLENDER) demo/museum_room/make_photos.py --scale 2 --out out/museum_room_large
	$(ENGINE) -m engine reconstruct out/museum_room_large/photos --out out/museum_room_large/project --device cpu \
		--prompt "$(EXHIBITS)"
ifneq ($(MONSTREE),)
	$(ENGINE) -m engine reconstruct "$(MONSTREE)" --out out/monstree/project --device cpu
	$(ENGINE) -m engine segment out/monstree/project --box IMG_1028.JPG=465,610,3240,2940 --name face
endif
	$(ENGINE) -m benchmarks.own_size --project out/museum_room/project --project out/museum_room_large/project \
		$(if $(MONSTREE),--project out/monstree/project) --doc docs/detail.md

bench-meshes: setup ## meshes of the exhibits of generated rooms beside true ones, into docs/meshes.md; ROOMS="out/rooms/room_1 ..."; a minute an object
	$(ENGINE) -m benchmarks.meshes $(ROOMS) --work out/meshes --doc docs/meshes.md --picture docs/pictures/meshes.jpg \
		--shown "room_5/sailing ship" "room_5/goblet 1" room_5/vase

bench-path: setup ## the path from photos to the report taken apart, into docs/run_time.md; RUNS="FILE.json ..." of other machines; 10 minutes of two free cores
	$(ENGINE) -m benchmarks.path run --out out/path
	$(ENGINE) -m benchmarks.path document out/path/path.json $(RUNS) --doc docs/run_time.md

bench-scale: setup ## cameras of 25 to 300 photos of a generated building and of real sets, into docs/many_photos.md; SETS=building_1000 for more; resumable; an hour
	$(ENGINE) -m benchmarks.scale $(if $(SETS),--sets $(SETS)) --doc docs/many_photos.md

bench-formats: setup ## time, size and memory of exported files beside other programs, into docs/formats.md; 5 minutes
	$(ENGINE) -m benchmarks.formats speed --doc docs/formats.md

readers-test: setup ## exported files in other programs and viewers; needs npm, Chromium and the project of `make demo`; 10 minutes
	$(ENGINE) -m benchmarks.formats readers --project out/museum_room/project --doc docs/formats.md --pictures docs/pictures/formats
	$(ENGINE) -m benchmarks.formats meshes --project out/museum_room/project --doc docs/meshes.md --pictures docs/pictures/formats

bench-packages: setup page ## verify beside sha256sum, and the cost of a package, into docs/records.md; needs the project of `make demo`
	$(ENGINE) -m benchmarks.packages --project out/museum_room/project --doc docs/records.md

bench-serve: page ## cost of the web server and its page, into docs/web.md; needs the project of `make demo`; 2 minutes
	$(ENGINE) -m benchmarks.serve --project out/museum_room/project --doc docs/web.md

bench-batch: setup ## cost of a batch, and workers killed at random moments, into docs/batch.md; 40 minutes of two free cores
	$(ENGINE) -m benchmarks.batch speed --doc docs/batch.md
	$(ENGINE) -m benchmarks.batch kills --folders 4 --doc docs/batch.md
	$(ENGINE) -m benchmarks.batch kills --folders 2 --kills 30 --prompts vase --doc docs/batch.md
	$(ENGINE) -m benchmarks.batch split --doc docs/batch.md
	$(ENGINE) -m benchmarks.batch simulation --doc docs/batch.md

video: setup ## a film of the room and three objects, and a picture, into docs/pictures; needs the project of `make demo`; 5 minutes
	$(ENGINE) -m benchmarks.video --project out/museum_room/project --out docs/pictures
