-- SPDX-License-Identifier: MIT OR Apache-2.0

library ieee;
  use ieee.std_logic_1164.all;
  use ieee.numeric_std.all;

library pe_lib;
  use pe_lib.pe_pkg.all;
  use pe_lib.pe_register_pkg.all;

-- Purpose:  AXI4-Stream in and out: a frame gives the inputs of a step, another one its outputs.
-- Generics: A frame has as many words of 32 bits as the window, the first one in front; without inputs there are no frames
--           in. Outputs are on ports, or, if there are none, are copied word by word.
-- Timing:   load_o gives the words of a frame to the step that begins next, and is 1 for one clock. ready_o is 0 until
--           they are there, and while outputs would have no place: at most two steps are under way or not yet sent. The
--           outputs of a step stay on the ports of the network until the next one ends, so they wait there; copied ones
--           have a bank, beside that of the frame that is sent. A frame with another number of words is dropped and told.

entity pe_stream is
  generic (
    INPUT_WORDS  : natural; -- words of a frame in
    OUTPUT_WORDS : natural; -- words of a frame out
    PORT_WORDS   : natural  -- words on ports: all or none
  );
  port (
    clk_i         : in    std_ulogic;                                                                      -- clock
    aresetn       : in    std_ulogic;                                                                      -- 0 forgets frames of the bus
    s_axis_tdata  : in    std_ulogic_vector(31 downto 0);                                                  -- word of a frame in
    s_axis_tlast  : in    std_ulogic;                                                                      -- its last one
    s_axis_tvalid : in    std_ulogic;                                                                      -- there is one
    s_axis_tready : out   std_ulogic;                                                                      -- it is taken
    m_axis_tdata  : out   std_ulogic_vector(31 downto 0);                                                  -- word of a frame out
    m_axis_tlast  : out   std_ulogic;                                                                      -- its last one
    m_axis_tvalid : out   std_ulogic;                                                                      -- there is one
    m_axis_tready : in    std_ulogic;                                                                      -- it is taken
    renew_i       : in    std_ulogic;                                                                      -- forgets all frames
    take_i        : in    std_ulogic;                                                                      -- inputs come from the window
    run_i         : in    run_state_t;                                                                     -- what happens
    ready_o       : out   std_ulogic;                                                                      -- a step can begin
    load_o        : out   std_ulogic;                                                                      -- inputs come from the frame
    frame_o       : out   std_ulogic_vector(maximum(32 * INPUT_WORDS, 1) - 1 downto 0);                    -- they
    wrong_o       : out   std_ulogic;                                                                      -- event: a frame was dropped
    outputs_i     : in    std_ulogic_vector(maximum(32 * PORT_WORDS, 1) - 1 downto 0);                     -- outputs of the network
    copy_i        : in    std_ulogic;                                                                      -- a word of them is copied
    place_i       : in    std_ulogic_vector(larger(index_bits(maximum(OUTPUT_WORDS, 1)), 1) - 1 downto 0); -- its number
    data_i        : in    std_ulogic_vector(31 downto 0);                                                  -- it
    copied_i      : in    std_ulogic                                                                       -- the last one is copied
  );
end entity pe_stream;

architecture rtl of pe_stream is

  constant PLACE_BITS : positive := larger(index_bits(maximum(OUTPUT_WORDS, 1)), 1);

  -- A frame that comes in
  signal frame    : std_ulogic_vector(frame_o'range)           := (others => '0');
  signal count    : natural range 0 to maximum(INPUT_WORDS, 1) := 0;
  signal full     : std_ulogic                                 := '0';
  signal dropping : std_ulogic                                 := '0'; -- until the end of the frame
  signal loaded   : std_ulogic                                 := '0'; -- the next step has its inputs
  signal load     : std_ulogic;
  signal taken    : std_ulogic;
  signal wrong    : std_ulogic                                 := '0';

  -- Frames that go out
  signal left      : natural range 0 to maximum(OUTPUT_WORDS, 1) := 0;   -- words to send
  signal waiting   : std_ulogic                                  := '0'; -- a frame is on the ports, or copied
  signal complete  : std_ulogic;                                         -- all of it is there
  signal offered   : std_ulogic;                                         -- a word is offered
  signal taken_out : std_ulogic;                                         -- and taken
  signal begin_out : std_ulogic;                                         -- the next frame is sent
  signal under_way : unsigned(1 downto 0)                        := "00";
  signal places    : natural range 0 to 5;

begin

  taken <= s_axis_tvalid and not full;
  load  <= full and run_i.streaming and run_i.more and not loaded;

  p_frame : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      wrong <= '0';

      if (taken = '1') then

        for i in 0 to INPUT_WORDS - 1 loop

          if (count = i) then
            frame(32 * i + 31 downto 32 * i) <= s_axis_tdata;
          end if;

        end loop;

        if (s_axis_tlast = '1') then
          count    <= 0;
          dropping <= '0';
          full     <= '1';

          if (dropping = '1' or count /= INPUT_WORDS - 1) then
            full  <= '0';
            wrong <= '1';
          end if;
        elsif (count >= INPUT_WORDS - 1) then
          dropping <= '1';
        else
          count <= count + 1;
        end if;
      end if;

      if (load = '1') then
        full   <= '0';
        loaded <= '1';
      end if;

      if (run_i.begins = '1') then
        loaded <= '0';
      end if;

      -- The words of a frame whose step was not to be are lost.
      if (take_i = '1' and loaded = '1') then
        loaded <= '0';
        wrong  <= '1';
      end if;

      if (renew_i = '1') then
        count    <= 0;
        full     <= '0';
        loaded   <= '0';
        dropping <= '0';
      end if;

      if (aresetn = '0') then
        count    <= 0;
        full     <= '0';
        dropping <= '0';
      end if;
    end if;

  end process p_frame;

  p_send : process (clk_i) is
  begin

    if rising_edge(clk_i) then
      if (run_i.begins = '1' and run_i.done = '0') then
        under_way <= under_way + 1;
      elsif (run_i.begins = '0' and run_i.done = '1') then
        under_way <= under_way - 1;
      end if;

      if (taken_out = '1') then
        left <= left - 1;
      end if;

      if (run_i.done = '1' and run_i.streaming = '1') then
        waiting <= '1';
      end if;

      if (begin_out = '1') then
        left    <= OUTPUT_WORDS;
        waiting <= '0';
      end if;

      if (renew_i = '1') then
        under_way <= "00";
        waiting   <= '0';
      end if;

      if (aresetn = '0') then
        left    <= 0;
        waiting <= '0';
      end if;
    end if;

  end process p_send;

  taken_out <= offered and m_axis_tready;
  begin_out <= waiting and complete when left = 0 else
               '0';

  g_ports : if PORT_WORDS = OUTPUT_WORDS generate

    signal sent : std_ulogic_vector(outputs_i'range) := (others => '0');

  begin

    p_sent : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        if (taken_out = '1') then
          sent <= std_ulogic_vector(shift_right(unsigned(sent), 32));
        end if;

        if (begin_out = '1') then
          sent <= outputs_i;
        end if;
      end if;

    end process p_sent;

    complete     <= '1';
    offered      <= '1' when left /= 0 else
                    '0';
    m_axis_tdata <= sent(31 downto 0);

  end generate g_ports;

  -- Two banks: of the frame that is sent, and of the one that is copied.

  g_copied : if PORT_WORDS /= OUTPUT_WORDS generate

    signal bank          : std_ulogic                          := '0'; -- of the frame that is sent
    signal there         : std_ulogic                          := '0';
    signal valid         : std_ulogic                          := '0';
    signal place         : unsigned(place_i'range)             := (others => '0');
    signal ahead         : unsigned(place_i'range);
    signal write         : std_ulogic;
    signal write_address : std_ulogic_vector(PLACE_BITS downto 0);
    signal read_address  : std_ulogic_vector(PLACE_BITS downto 0);

  begin

    -- The word of the next clock is read in this one.
    ahead         <= place + 1 when taken_out = '1' else
                     place;
    write         <= copy_i and waiting and not there;
    write_address <= not bank & place_i;
    read_address  <= bank & std_ulogic_vector(ahead);

    p_sent : process (clk_i) is
    begin

      if rising_edge(clk_i) then
        place <= ahead;
        valid <= '0';

        if (left > 1 or (left = 1 and taken_out = '0')) then
          valid <= '1';
        end if;

        if (copied_i = '1' and waiting = '1') then
          there <= '1';
        end if;

        if (begin_out = '1') then
          bank  <= not bank;
          there <= '0';
          place <= (others => '0');
        end if;

        if (waiting = '0' or renew_i = '1' or aresetn = '0') then
          there <= '0';
        end if;

        if (aresetn = '0') then
          valid <= '0';
        end if;
      end if;

    end process p_sent;

    u_banks : entity pe_lib.pe_ram
      generic map (
        WORDS     => 2 ** (PLACE_BITS + 1),
        WORD_BITS => 32,
        IMAGE     => zeros(2 ** (PLACE_BITS + 1), 32)
      )
      port map (
        clk_i           => clk_i,
        ce_i            => '1',
        write_enable_i  => write,
        write_address_i => write_address,
        write_data_i    => data_i,
        read_enable_i   => '1',
        read_address_i  => read_address,
        default_i       => (others => '0'),
        read_data_o     => m_axis_tdata
      );

    complete <= there;
    offered  <= valid;

  end generate g_copied;

  -- Steps under way and frames that are not yet sent
  p_places : process (under_way, waiting, left) is

    variable sum : natural range 0 to 5;

  begin

    sum := to_integer(under_way);

    if (waiting = '1') then
      sum := sum + 1;
    end if;

    if (left /= 0) then
      sum := sum + 1;
    end if;

    places <= sum;

  end process p_places;

  g_inputs : if INPUT_WORDS > 0 generate

    s_axis_tready <= not full;
    ready_o       <= loaded when places < 2 else
                     '0';
    load_o        <= load;

  end generate g_inputs;

  g_no_inputs : if INPUT_WORDS = 0 generate

    s_axis_tready <= '0';
    ready_o       <= '1' when places < 2 else
                     '0';
    load_o        <= '0';

  end generate g_no_inputs;

  frame_o       <= frame;
  wrong_o       <= wrong;
  m_axis_tlast  <= '1' when left = 1 else
                   '0';
  m_axis_tvalid <= offered;

end architecture rtl;
