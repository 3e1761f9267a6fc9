"""The order in which workers begin the files of tests."""

# Files that take longest: first those of slow tests, then those whose quick tests take three
# seconds of the processor. A worker takes a file as a whole, and one that is begun last keeps it
# busy when the others have nothing left to do. Two that compile the same kernels are not begun at
# once, as those of scans would be: each worker would compile them.
LONGEST = (
    "test_fleet_serving", "test_openjd_run", "test_cli_interrupted", "test_engine_model",
    "test_engine_face", "test_stage_stiffness", "test_shared_store", "test_fleet_mending",
    "test_process_starts", "test_api_kept", "test_process_shared", "test_cli_shared_store",
    "test_engine_scanned", "test_stage_cushion", "test_engine_lengths", "test_cli_trace",
    "test_format_scans", "test_stage_rows", "test_decoding", "test_api_scan",
    "test_synthesis_controls", "test_kernel_line", "test_hosts_skin", "test_engine_packages",
    "test_engine_levels", "test_tracing_trace", "test_engine_cushion", "test_kernel_blend",
    "test_engine_grain", "test_stage_shares", "test_engine_store", "test_stage_bins",
    "test_kernel_weights", "test_shared_damage", "test_house_imports", "test_api_stiffness",
    "test_engine_events", "test_synthesis_generate", "test_api_memory", "test_synthesis_leaders",
    "test_engine_slopes", "test_kernel_draw", "test_dask_run", "test_texture_files",
    "test_mesh_scan_check", "test_package_scanned", "test_stage_convolve_smooth",
    "test_kernel_convolve", "test_cli_check", "test_engine_waves", "test_engine_local_copies",
    "test_engine_memory", "test_house_docker", "test_surface_patch", "test_engine_nearby",
    "test_transfer", "test_cli_displace",
)  # fmt: skip
